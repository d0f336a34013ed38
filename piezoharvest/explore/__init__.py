"""A local page with sliders for a study or a campaign: what is shown is computed by the engine at every move.

`study.py` and `campaign.py` compute, `study_page.py` and `campaign_page.py` draw, `knobs.py` makes sliders of fields,
`server.py` serves the page to this machine alone.
"""
