"""Who may do what on the bus: certificates by service, and the router's rules made from the key table."""

from crosspih_common.security.credentials import (
    CERTIFICATES,
    Credentials,
    credentials_from_environment,
    open_to_whom,
    secure_endpoint,
)

__all__ = ["CERTIFICATES", "Credentials", "credentials_from_environment", "open_to_whom", "secure_endpoint"]
