"""What a person looks at after a session: report.html.

page.py     the page, from the files that the session left
plots.py    its plots; latency.py: from the sample to the light
"""
