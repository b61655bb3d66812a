"""The processes, and what a person types to start them.

cli.py       the commands, their options and their errors
settings.py  what a settings file may hold
process.py   what all processes do alike: logs, signals, ending with their parent
bridge.py    the bridge process: publishes a source
worker.py    the pipeline process: renders what the bridge publishes
session.py   starts both, shows progress, gathers the results
report.py    what a person looks at afterwards
"""
