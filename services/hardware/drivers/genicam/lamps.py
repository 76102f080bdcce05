"""The cell's lamps on the cameras' outputs: LineSelector with UserOutputSelector, or LineInverter alone."""

from __future__ import annotations

from services.hardware.drivers.genicam.camera import GenicamCamera
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

    def light(self, wanted: int, left: GenicamCamera, right: GenicamCamera) -> bool:
        """Light the wanted lamp, and only it; True when there is one. One that is not there leaves lamp 0.

        Raises CameraAway.
        """
        if not self._lamps:
            return False
        lit = wanted if wanted < len(self._lamps) else 0
        for index, lamp in enumerate(self._lamps):
            if index != lit:
                self._switch_on(index, lamp, left, right, on=False)
        self._switch_on(lit, self._lamps[lit], left, right, on=True)
        return True

    def dark(self, left: GenicamCamera, right: GenicamCamera) -> None:
        """No lamp burns. Raises CameraAway."""
        for index, lamp in enumerate(self._lamps):
            self._switch_on(index, lamp, left, right, on=False)

    def _switch_on(self, index: int, lamp: LampConfig, left: GenicamCamera, right: GenicamCamera, on: bool) -> None:
        with (left if lamp.camera == "left" else right).answering() as features:
            self._switch(index, lamp, features, on)

    def _switch(self, index: int, lamp: LampConfig, features: Features, on: bool) -> None:
        setting = f"lamps[{index}]"
        if lamp.output is not None:
            features.choose("UserOutputSelector", lamp.output, f"{setting}.output")
            features.switch("UserOutputValue", on, f"{setting}.output")
        else:
            features.choose("LineSelector", lamp.line, f"{setting}.line")
            features.switch("LineInverter", on != lamp.active_low, f"{setting}.line")
