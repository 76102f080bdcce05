"""The cell's lamps on the cameras' outputs: LineSelector with UserOutputSelector, or LineInverter alone."""

from __future__ import annotations

from services.hardware.drivers.genicam.config import GenicamConfig, LampConfig
from services.hardware.drivers.genicam.features import Features


class Lamps:
    """Lights one lamp at a time; the others are dark. Without lamps in the cell's file it does nothing."""

    def __init__(self, config: GenicamConfig) -> None:
        self._lamps = config.lamps

    def set_up(self, side: str, features: Features) -> None:
        """Make the lines of this camera outputs and dark. Raises ConfigError naming the lamp and what there is."""
        for index, lamp in enumerate(self._lamps):
            if lamp.camera != side:
                continue
            features.choose("LineSelector", lamp.line, f"lamps[{index}].line")
            if features.has("LineMode"):
                features.choose("LineMode", "Output", f"lamps[{index}].line")
            if lamp.output is not None:
                features.choose("UserOutputSelector", lamp.output, f"lamps[{index}].output")
                features.choose("LineSource", lamp.output, f"lamps[{index}].output")
                if features.has("LineInverter"):
                    features.switch("LineInverter", lamp.active_low, f"lamps[{index}].active_low")
            self._switch(index, lamp, features, on=False)

    def light(self, wanted: int, left: Features, right: Features) -> bool:
        """Light the wanted lamp, and only it; True when there is one. One that is not there leaves lamp 0."""
        if not self._lamps:
            return False
        lit = wanted if wanted < len(self._lamps) else 0
        self._all_but(lit, left, right)
        lamp = self._lamps[lit]
        self._switch(lit, lamp, left if lamp.camera == "left" else right, on=True)
        return True

    def dark(self, left: Features, right: Features) -> None:
        """No lamp burns."""
        self._all_but(None, left, right)

    def _all_but(self, lit: int | None, left: Features, right: Features) -> None:
        for index, lamp in enumerate(self._lamps):
            if index != lit:
                self._switch(index, lamp, left if lamp.camera == "left" else right, on=False)

    def _switch(self, index: int, lamp: LampConfig, features: Features, on: bool) -> None:
        setting = f"lamps[{index}]"
        if lamp.output is not None:
            features.choose("UserOutputSelector", lamp.output, f"{setting}.output")
            features.switch("UserOutputValue", on, f"{setting}.output")
        else:
            features.choose("LineSelector", lamp.line, f"{setting}.line")
            features.switch("LineInverter", on != lamp.active_low, f"{setting}.line")
