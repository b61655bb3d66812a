"""HID: report descriptors (items.py, descriptor.py), reports, and what an eye tracker's fields mean (usages.py on)."""
