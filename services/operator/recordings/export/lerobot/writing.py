"""A LeRobot dataset on the disk, format v3.0: https://huggingface.co/docs/lerobot, read back by LeRobotDataset."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.errors import ConfigError
from services.operator.recordings.export.lerobot.episodes import PHASES, Episode
from services.operator.recordings.export.lerobot.statistics import Statistics, of_pictures, of_rows
from services.operator.recordings.export.lerobot.video import write_video

VERSION = "v3.0"
FILES = "chunk-{chunk_index:03d}/file-{file_index:03d}"
MAX_FILES = 1000  # a chunk
INDICES = ("frame_index", "episode_index", "index", "task_index", "subtask_index")
AXES = ("x", "y", "z")


class Dataset:
    """A dataset being written: `add` each episode, then `finish`. All have one arm and one rate.

    Raises ConfigError where the folder already exists, without pyarrow or av, or for an episode of another arm.
    """

    def __init__(self, root: Path, robot: str, joint_names: tuple[str, ...], fps: int) -> None:
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            raise ConfigError("a LeRobot dataset needs pyarrow and av: pip install 'crosspih[lerobot]'") from None
        if root.exists():
            raise ConfigError(f"{root}: is there already; name a folder that is not")
        self._root, self._robot, self._fps = root, robot, fps
        self._features = _features(joint_names)
        self._rows: dict[str, list[NDArray[Any]]] = {}
        self._episodes: list[dict[str, Any]] = []
        self._pictures: dict[str, list[Statistics]] = {}
        self._tasks: dict[str, int] = {}
        self._frames = 0

    def add(self, episode: Episode) -> None:
        """Add the next episode."""
        number, length = len(self._episodes), episode.length
        task = self._tasks.setdefault(episode.task, len(self._tasks))
        frames = np.arange(length)
        last = frames == length - 1
        columns: dict[str, NDArray[Any]] = {
            "observation.state": episode.joints_rad,
            "observation.speed": episode.speeds_rad_s,
            "observation.wrench": episode.wrench,
            "observation.peg_pose": episode.peg,
            "action": episode.action,
            "next.success": last & episode.inserted,
            "next.done": last,
            "timestamp": frames / self._fps,
            "frame_index": frames,
            "episode_index": np.full(length, number),
            "index": frames + self._frames,
            "task_index": np.full(length, task),
            "subtask_index": episode.phases,
        }
        about: dict[str, Any] = {
            "episode_index": number, "tasks": [episode.task], "length": length, "data/chunk_index": 0,
            "data/file_index": 0, "dataset_from_index": self._frames, "dataset_to_index": self._frames + length,
            "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
        }  # fmt: skip
        statistics = {name: of_rows(rows) for name, rows in columns.items()}
        for side, (numbers, pictures) in episode.pictures.items():
            if pictures:
                statistics[self._add_video(side, number, numbers, pictures, about)] = of_pictures(pictures, numbers)
        for name, found in statistics.items():
            about |= {f"stats/{name}/{statistic}": values.tolist() for statistic, values in found.items()}
        for name, rows in columns.items():
            self._rows.setdefault(name, []).append(rows)
        self._episodes.append(about)
        self._frames += length

    def _add_video(
        self, side: str, number: int, numbers: NDArray[np.int64], pictures: list[NDArray[np.uint8]],
        about: dict[str, Any],
    ) -> str:  # fmt: skip
        key = f"observation.images.{side}"
        chunk, file = divmod(number, MAX_FILES)
        path = self._root / "videos" / key / f"{FILES.format(chunk_index=chunk, file_index=file)}.mp4"
        codec = write_video(path, pictures, numbers, self._fps)
        height, width = pictures[0].shape[:2]
        self._features[key] = {
            "dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"],
            "info": {
                "video.fps": self._fps, "video.height": height, "video.width": width, "video.channels": 3,
                "video.codec": codec, "video.pix_fmt": "yuv420p", "video.is_depth_map": False, "has_audio": False,
            },
        }  # fmt: skip
        about |= {
            f"videos/{key}/chunk_index": chunk, f"videos/{key}/file_index": file, f"videos/{key}/from_timestamp": 0.0,
            f"videos/{key}/to_timestamp": len(numbers) / self._fps,
        }  # fmt: skip
        self._pictures.setdefault(key, []).append(of_pictures(pictures, numbers))
        return key

    def finish(self) -> None:
        """Write everything but the videos, which are already written. Raises ConfigError where there is no episode."""
        if not self._episodes:
            raise ConfigError("no assembly with an answer is in these recordings: nothing to make a dataset of")
        rows = {name: np.concatenate(parts) for name, parts in self._rows.items()}
        videos = {key for key in self._features if key.startswith("observation.images.")}
        for about in self._episodes:
            if lacking := [key for key in videos if f"videos/{key}/file_index" not in about]:
                raise ConfigError(f"episode {about['episode_index']} has no pictures of {', '.join(lacking)}")
        self._write_data(rows)
        _write_table(self._root / "meta" / "episodes" / f"{FILES.format(chunk_index=0, file_index=0)}.parquet",
                     {name: [about[name] for about in self._episodes] for name in self._episodes[0]})  # fmt: skip
        _write_named(self._root / "meta" / "tasks.parquet", "task", list(self._tasks))
        _write_named(self._root / "meta" / "subtasks.parquet", "subtask", list(PHASES))
        found = {name: of_rows(values) for name, values in rows.items()}
        found |= {key: _together(parts) for key, parts in self._pictures.items()}
        _write_json(self._root / "meta" / "stats.json", {
            name: {statistic: values.tolist() for statistic, values in each.items()} for name, each in found.items()
        })  # fmt: skip
        count = len(self._episodes)
        _write_json(self._root / "meta" / "info.json", {
            "codebase_version": VERSION, "robot_type": self._robot, "total_episodes": count,
            "total_frames": self._frames, "total_tasks": len(self._tasks), "chunks_size": MAX_FILES,
            "data_files_size_in_mb": 100, "video_files_size_in_mb": 200, "fps": self._fps,
            "splits": {"train": f"0:{count}"}, "data_path": f"data/{FILES}.parquet",
            "video_path": "videos/{video_key}/" + f"{FILES}.mp4" if videos else None, "features": self._features,
        })  # fmt: skip

    def _write_data(self, rows: dict[str, NDArray[Any]]) -> None:
        import pyarrow as pa

        arrays = {}
        for name, values in rows.items():
            feature = self._features[name]
            kind = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}[feature["dtype"]]
            if feature["shape"] == [1]:
                arrays[name] = pa.array(values, kind)
            else:
                arrays[name] = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel(), kind), values.shape[1])
        _write(self._root / "data" / f"{FILES.format(chunk_index=0, file_index=0)}.parquet", pa.table(arrays))


def _features(joint_names: tuple[str, ...]) -> dict[str, Any]:
    """Names, shapes and units of the columns."""
    names = list(joint_names)

    def numbers(of: list[str]) -> dict[str, Any]:
        return {"dtype": "float32", "shape": [len(of)], "names": of}

    one = {"shape": [1], "names": None}
    return {
        "observation.state": numbers([f"{name}_rad" for name in names]),
        "observation.speed": numbers([f"{name}_rad_s" for name in names]),
        "observation.wrench": numbers([f"f{axis}_n" for axis in AXES] + [f"m{axis}_nm" for axis in AXES]),
        "observation.peg_pose": numbers([f"{axis}_m" for axis in AXES] + ["qx", "qy", "qz", "qw"]),
        "action": numbers([f"{name}_rad" for name in names]),
        "next.success": {"dtype": "bool", **one},
        "next.done": {"dtype": "bool", **one},
        "timestamp": {"dtype": "float32", **one},
        **{name: {"dtype": "int64", **one} for name in INDICES},
    }


def _together(parts: list[Statistics]) -> Statistics:
    """The statistics over all episodes' pictures: the mean of theirs, weighted by length."""
    counts = np.array([part["count"][0] for part in parts])
    found = {name: np.average([part[name] for part in parts], axis=0, weights=counts) for name in parts[0]}
    found["min"] = np.min([part["min"] for part in parts], axis=0)
    found["max"] = np.max([part["max"] for part in parts], axis=0)
    found["count"] = np.array([counts.sum()])
    return found


def _write(path: Path, table: Any) -> None:
    import pyarrow.parquet

    path.parent.mkdir(parents=True, exist_ok=True)
    pyarrow.parquet.write_table(table, path, compression="zstd")


def _write_table(path: Path, columns: dict[str, list[Any]]) -> None:
    import pyarrow as pa

    _write(path, pa.table(columns))


def _write_named(path: Path, name: str, values: list[str]) -> None:
    """Write names with their numbers, the names as a pandas index."""
    import pyarrow as pa

    column = f"{name}_index"
    about = {
        "index_columns": [name], "column_indexes": [], "pandas_version": "2.0.0",
        "columns": [
            {"name": column, "field_name": column, "pandas_type": "int64", "numpy_type": "int64", "metadata": None},
            {"name": name, "field_name": name, "pandas_type": "unicode", "numpy_type": "object", "metadata": None},
        ],
    }  # fmt: skip
    table = pa.table({column: list(range(len(values))), name: values})
    _write(path, table.replace_schema_metadata({b"pandas": json.dumps(about).encode()}))


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")
