"""The life of a service: configuration, bus, status, signals, and a clean end."""

from crosspih_common.service.lifecycle import ServiceContext, run_service

__all__ = ["ServiceContext", "run_service"]
