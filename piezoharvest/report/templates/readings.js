// Values of the curve that is nearest to the pointer, in every figure.
"use strict";
{
  const REACH = 24; // points of the figure, about a third of an inch
  const numbers = path => path.match(/[ML] *-?[\d.e+-]+[ ,]-?[\d.e+-]+/g)?.map(part =>
    ({ starts: part[0] === "M", x: +part.slice(1).trim().split(/[ ,]+/)[0], y: +part.slice(1).trim().split(/[ ,]+/)[1] })) ?? [];

  // Points of the lines and markers of axes, in the figure's coordinates.
  const points = group => {
    const found = [];
    for (const line of group.querySelectorAll(':scope > [id*="-line2d_"]')) {
      for (const path of line.querySelectorAll(":scope > path")) found.push(...numbers(path.getAttribute("d")));
      for (const mark of line.querySelectorAll("use")) found.push({ starts: true, x: +mark.getAttribute("x"), y: +mark.getAttribute("y") });
    }
    return found;
  };

  // The point of a polyline that is nearest to a place: on the segment that ends at each of its points.
  const nearest = (line, place) => {
    let best = null;
    line.forEach((end, n) => {
      const start = end.starts ? end : line[n - 1], dx = end.x - start.x, dy = end.y - start.y;
      const along = dx || dy ? ((place.x - start.x) * dx + (place.y - start.y) * dy) / (dx * dx + dy * dy) : 0;
      const share = Math.min(1, Math.max(0, along)), x = start.x + share * dx, y = start.y + share * dy;
      const far = Math.hypot(x - place.x, y - place.y);
      if (best === null || far < best.far) best = { x, y, far };
    });
    return best;
  };

  const PREFIXES = ["f", "p", "n", "µ", "m", "", "k", "M", "G", "T"];
  const reading = (axis, share) => {
    const [low, high] = axis.ends;
    const value = (axis.scale === "log" ? low * (high / low) ** share : low + (high - low) * share) / axis.factor;
    // What is less than a thousandth of the span is not told from zero.
    const shown = axis.scale === "log" || Math.abs(value) > 1e-4 * Math.abs(high - low) / axis.factor ? value : 0;
    if (axis.unit === null) return `${axis.label}: ${Number(shown.toPrecision(4))}`;
    const power = shown ? Math.max(-5, Math.min(4, Math.floor(Math.log10(Math.abs(shown)) / 3 + 1e-9))) : 0;
    return `${axis.label}: ${Number((shown / 10 ** (3 * power)).toPrecision(4))} ${PREFIXES[power + 5]}${axis.unit}`;
  };

  for (const svg of document.querySelectorAll("figure svg[data-axes]")) {
    const axes = JSON.parse(svg.dataset.axes), note = document.createElement("output"), lines = new Map();
    const mark = svg.appendChild(document.createElementNS(svg.namespaceURI, "circle"));
    mark.setAttribute("class", "read");
    note.className = "reading";
    svg.after(note);
    const clear = () => { note.textContent = ""; mark.setAttribute("r", 0); };
    const show = event => {
      const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const n = axes.findIndex(one => one && place.x >= one.frame[0] && place.x <= one.frame[2]
        && place.y >= one.frame[1] && place.y <= one.frame[3]);
      const group = n < 0 ? null : svg.querySelector(`[id$="-axes_${n + 1}"]`);
      if (group && !lines.has(n)) lines.set(n, points(group));
      const found = group && nearest(lines.get(n), place);
      if (!found || found.far > REACH) return clear();
      const [left, top, right, bottom] = axes[n].frame;
      note.textContent = [reading(axes[n].x, (found.x - left) / (right - left)),
        reading(axes[n].y, (bottom - found.y) / (bottom - top))].join("\n");
      for (const [key, value] of Object.entries({ cx: found.x, cy: found.y, r: 3 })) mark.setAttribute(key, value);
      const box = svg.getBoundingClientRect(), around = svg.parentElement.getBoundingClientRect();
      const x = event.clientX - around.left + 12, y = event.clientY - around.top + 12;
      note.style.left = `${Math.max(0, Math.min(x, box.right - around.left - note.offsetWidth))}px`;
      note.style.top = `${y}px`;
    };
    svg.addEventListener("pointermove", show);
    svg.addEventListener("pointerdown", show);
    // A finger is lifted to read: what it has shown stays until it touches elsewhere.
    svg.addEventListener("pointerleave", event => { if (event.pointerType !== "touch") clear(); });
    document.addEventListener("pointerdown", event => { if (!svg.contains(event.target)) clear(); });
    addEventListener("resize", clear);
  }
}
