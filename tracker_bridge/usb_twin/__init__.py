"""The USB tracker's twin: a pyusb backend that plays a recording as such a device, faults included."""
