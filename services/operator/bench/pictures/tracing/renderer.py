"""The path tracer, imported on use: a development extra, never needed to run a cell."""

from __future__ import annotations

from typing import Any

from crosspih_common.errors import CrosspihError

VARIANT = "scalar_rgb"
"""Runs everywhere; the vectorised variants need LLVM's library on the machine, and a release of it that fits."""
EXTRA = "the pictures' renderer is not installed; install it with `pip install 'crosspih[render]'`"


_chosen = [VARIANT]


def use(variant: str) -> None:
    """Take another variant from now on, for example `llvm_ad_rgb`. Raises CrosspihError where it cannot be had."""
    _chosen[0] = variant
    mitsuba()


def mitsuba() -> Any:
    """Mitsuba 3, its variant set. Raises CrosspihError where it is not installed."""
    try:
        import mitsuba as mi
    except ImportError:
        raise CrosspihError(EXTRA) from None
    if mi.variant() != _chosen[0]:
        try:
            mi.set_variant(_chosen[0])
        except ImportError as error:
            raise CrosspihError(
                f"--variant {_chosen[0]}: {str(error).splitlines()[0]}; {VARIANT} runs everywhere"
            ) from None
    return mi
