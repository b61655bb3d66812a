"""Any table of eye data, by a column map: source.py reads it, map.py has a map's keys; maps/ come with the program."""
