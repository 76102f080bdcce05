"""ATI Net F/T and Ethernet Axia sensors: RDT over UDP, configuration from the box's XML page."""
