"""A session by recorded time.

offline.py  bridge and worker as two processes, their progress and what they leave
again.py    a folder's session once more, the same frames
"""
