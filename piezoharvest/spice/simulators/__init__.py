"""Other programs: ngspice run on a netlist and set beside the engine, and schematics for LTspice."""
