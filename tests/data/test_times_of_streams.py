"""Rule R10: `time:` chooses the clock of MDF files and ROS bags, or is refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF, Signal
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from msnn.data.dataset import Dataset
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from tests.data.specs import load

STEPS = np.arange(12)


def write_mdf(path: Path) -> None:
    """`x` with a clock of its own in ms, 3 s before that of the master; `F` in another group."""
    master = 3.0 + 0.2 * STEPS
    with MDF(version="4.10") as file:
        clock = Signal(200.0 * STEPS, master, name="gps", unit="ms")
        file.append([Signal(1.0 * STEPS, master, name="x"), clock])
        file.append([Signal(-1.0 * STEPS, master, name="F"), Signal(STEPS, master, name="n")])
        file.save(path, overwrite=True)


def fault(folder: Path, section: str) -> Diagnostic:
    with pytest.raises(SpecError) as caught:
        load(folder, section)
    (found,) = caught.value.diagnostics
    return found


def times(data: Dataset) -> np.ndarray:
    (piece,) = data.records[0].pieces
    assert piece.time is not None
    return np.asarray(piece.time)


def test_a_channel_of_the_group_is_the_time_in_its_unit(tmp_path: Path) -> None:
    write_mdf(tmp_path / "a.mf4")
    columns = "columns: {F: {column: gps, unit: N}}\n"
    by_file = load(tmp_path, f"source: {{train: a.mf4}}\ntime: gps\n{columns}")
    np.testing.assert_allclose(times(by_file), 0.2 * STEPS, atol=1e-12)
    # the unit of the spec before that of the file: steps of 200 min
    said = fault(tmp_path, f"source: {{train: a.mf4}}\ntime: {{column: gps, unit: min}}\n{columns}")
    assert (said.code, "12000 s apart" in said.message) == ("E0812", True)
    by_master = load(tmp_path, "source: {train: a.mf4}\ntime: time\n")
    np.testing.assert_allclose(times(by_master), 3.0 + 0.2 * STEPS, atol=1e-12)


def test_a_time_that_other_channels_do_not_have_is_refused(tmp_path: Path) -> None:
    write_mdf(tmp_path / "a.mf4")
    said = fault(tmp_path, "source: {train: a.mf4}\ntime: gps\n")
    assert (said.code, said.span is not None) == ("E0875", True)
    assert "`gps` of a.mf4 does not have the times of `F`" in said.message
    said = fault(tmp_path, "source: {train: a.mf4}\ntime: nonsense\n")
    assert (said.code, said.span is not None) == ("E0804", True)


def write_bag(
    path: Path, begin: float = 5e9, stamps: float | None = None, ros1: bool = False
) -> None:
    """`/imu` and `/arm` with stamps 0.2 s apart, recorded late; `/cmd` without a stamp."""
    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    known = types.types
    pose = known["geometry_msgs/msg/Vector3Stamped"]
    number = known["std_msgs/msg/Float64"]

    def stamped(i: int, value: float, late: int) -> tuple[int, Any]:
        now = int(begin + i * 2e8)
        stamp = int((begin if stamps is None else stamps) + i * 2e8)
        time = known["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
        header = known["std_msgs/msg/Header"](*((i,) if ros1 else ()), time, "")
        vector = known["geometry_msgs/msg/Vector3"](x=value, y=0.2 * i, z=0.0)
        return now + late, pose(header, vector)

    serialize = types.serialize_ros1 if ros1 else types.serialize_cdr
    with Ros1Writer(path) if ros1 else Ros2Writer(path, version=9) as bag:
        imu, arm = (
            bag.add_connection(t, pose.__msgtype__, typestore=types) for t in ("/imu", "/arm")
        )
        cmd = bag.add_connection("/cmd", number.__msgtype__, typestore=types)
        for i in range(12):
            now = int(begin + i * 2e8)
            bag.write(cmd, now, serialize(number(data=float(i)), number.__msgtype__))
            for topic, late in ((imu, 20_000_000 + 1_000_000 * i), (arm, 50_000_000)):
                at, message = stamped(i, float(i), late)
                bag.write(topic, at, serialize(message, pose.__msgtype__))


X, F = "x: /imu.vector.x", "F: /cmd.data"


@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize("time", ["header.stamp", "/imu.header.stamp"])
def test_a_stamp_is_the_time_of_its_message(tmp_path: Path, time: str, ros1: bool) -> None:
    name = "a.bag" if ros1 else "a/a.db3"
    write_bag(tmp_path / Path(name).parts[0], ros1=ros1)
    section = f"source: {{train: {name}}}\ncolumns: {{{X}, {F}}}\nresample: linear\n"
    recorded = load(tmp_path, section)
    assert not np.allclose(recorded.series["x"], recorded.series["F"])
    stamped = load(tmp_path, f"{section}time: {time}\n")
    np.testing.assert_allclose(stamped.series["x"], STEPS, atol=1e-9)
    np.testing.assert_allclose(stamped.series["F"], STEPS, atol=1e-9)
    np.testing.assert_allclose(times(stamped), 0.2 * STEPS, atol=1e-9)


def test_every_topic_with_a_stamp_has_its_own(tmp_path: Path) -> None:
    write_bag(tmp_path / "a")
    section = "source: {train: a/a.db3}\ncolumns: {x: /imu.vector.x, F: /arm.vector.x}\n"
    # without resampling: all times are the same
    both = load(tmp_path, f"{section}time: header.stamp\n")
    np.testing.assert_array_equal(both.series["x"], both.series["F"])
    assert fault(tmp_path, f"{section}time: /imu.header.stamp\n").code == "E0842"


def test_a_simulated_clock_begins_at_its_first_stamp(tmp_path: Path) -> None:
    write_bag(tmp_path / "a", begin=1.7e18, stamps=7e9)
    section = "source: {train: a/a.db3}\ncolumns: {x: /imu.vector.x, F: /arm.vector.x}\n"
    data = load(tmp_path, f"{section}time: header.stamp\nfrom: 0.4 s\n")
    np.testing.assert_allclose(times(data), 0.2 * STEPS[2:], atol=1e-12)


def test_numbers_are_the_time_of_one_topic(tmp_path: Path) -> None:
    write_bag(tmp_path / "a")
    one = "source: {train: a/a.db3}\ncolumns: {x: /imu.vector.x, F: /imu.vector.x}\n"
    data = load(tmp_path, f"{one}time: /imu.vector.y\n")
    np.testing.assert_allclose(times(data), 0.2 * STEPS, atol=1e-12)
    assert fault(tmp_path, f"{one}time: {{column: /imu.vector.y, unit: ms}}\n").code == "E0812"
    two = f"source: {{train: a/a.db3}}\ncolumns: {{{X}, {F}}}\n"
    assert fault(tmp_path, f"{two}time: /imu.vector.y\n").code == "E0875"


@pytest.mark.parametrize(
    ("time", "code"),
    [
        ("nonsense", "E0804"),
        ("/imu.header.nonsense", "E0804"),
        ("/arm.header.stamp", "E0875"),
        ("{column: header.stamp, unit: ms}", "E0998"),
    ],
)
def test_a_time_that_the_bag_does_not_have_is_refused(tmp_path: Path, time: str, code: str) -> None:
    write_bag(tmp_path / "a")
    section = f"source: {{train: a/a.db3}}\ncolumns: {{{X}, {F}}}\ntime: {time}\n"
    said = fault(tmp_path, section)
    assert (said.code, said.span is not None) == (code, True)


def test_bags_that_follow_each_other_are_joined_by_their_dates(tmp_path: Path) -> None:
    write_bag(tmp_path / "a")
    write_bag(tmp_path / "b", begin=5e9 + 12 * 2e8)
    columns = "columns: {x: /arm.vector.x, F: /arm.vector.x}\ntime: header.stamp\n"
    section = f"source: {{train: [a/a.db3, b/b.db3]}}\n{columns}"
    assert len(load(tmp_path, section).records) == 2
    assert load(tmp_path, f"{section}join: true\n").episodes("train").tolist() == [[0, 24]]
    part = load(tmp_path, f"{section}from: 1970-01-01 00:00:06Z\n")
    assert len(part.records[0].pieces[0].rows) == 7
