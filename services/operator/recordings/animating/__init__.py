"""A moving picture of an assembly, made from its recording alone."""
