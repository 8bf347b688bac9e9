"""Topics of ULog files: their names, times, dropouts, and files that are damaged."""

from __future__ import annotations

import random
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pyulog import ULog

from msnn.data.dataset import Dataset
from msnn.data.formats.isolation import reader as isolation
from msnn.data.formats.table import Streams, TimeSource, WantedColumns
from msnn.data.formats.table_of_formats import format_of
from msnn.data.formats.text.csv_header import Dialect
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.units.parser import parse_unit
from tests.data import ulog_files as ulog
from tests.data.specs import load

STEPS = np.arange(12)
TIME = 0.2 * STEPS
PLACE = Span(file="plant.msnn.yaml", line=3, column=7, end_line=3, end_column=9)
FORMATS = (
    ulog.topic_format(
        "attitude",
        "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;rates body;"
        "char[3] mode;bool armed;uint8_t[6] _padding0;",
    ),
    ulog.topic_format("rates", "double p;int16_t[2] raw;"),
    ulog.topic_format("sensor_accel", "uint64_t timestamp;float x;uint64_t count;"),
)
BEGIN = ulog.header() + ulog.flags() + b"".join(FORMATS)
PARAMETER = ulog.information("P", "int32_t SYS_ID", struct.pack("<i", 3))
SYSTEM = ulog.information("I", "char[3] sys_name", b"PX4")
SUBSCRIPTIONS = (
    ulog.subscription(7, "attitude")
    + ulog.subscription(2, "sensor_accel")
    + ulog.subscription(3, "sensor_accel", 1)
)


def attitude(step: int, late: int = 0) -> bytes:
    """q = (step, −step, 0.5, NaN), p = step / 8, raw = (step, −step), sampled 3 ms before."""
    at = ulog.START + 200_000 * step + late
    body = (step / 8, step, -step)
    q = (step, -step, 0.5, float("nan"))
    return ulog.data(7, "QQ4fd2h3s?", at, at - 3000, *q, *body, b"abc", step % 2 == 1)


def accel(step: int, instance: int) -> bytes:
    at = ulog.START + (200_000 >> instance) * step
    sign = 1 - 2 * instance
    return ulog.data(2 + instance, "QfQ", at, sign * step, 10**12 + step)


def log(more: bytes = b"") -> bytes:
    steps = b"".join(attitude(i) + accel(i, 0) + accel(i, 1) for i in range(12))
    return BEGIN + PARAMETER + SYSTEM + SUBSCRIPTIONS + steps + more


def streams(path: Path, *keys: str | int, time: str | None = None) -> Streams:
    source = None if time is None else TimeSource(time, PLACE)
    wanted = WantedColumns({key: f"`{key}`" for key in keys}, frozenset(keys), time=source)
    found = format_of(path).reader(path, path.name, wanted, Dialect())
    assert isinstance(found, Streams)
    return found


def faults(path: Path, *keys: str | int, time: str | None = None) -> tuple[Diagnostic, ...]:
    with pytest.raises(SpecError) as caught:
        streams(path, *keys, time=time)
    return caught.value.diagnostics


def times(data: Dataset) -> np.ndarray:
    (piece,) = data.records[0].pieces
    assert piece.time is not None
    return np.asarray(piece.time)


FIELDS = {
    "attitude.q[0]": 1.0 * STEPS,
    "attitude_0.q[1]": -1.0 * STEPS,
    "attitude.q[3]": np.full(12, np.nan),
    "attitude.body.p": STEPS / 8,
    "attitude.body.raw[1]": -1.0 * STEPS,
    "attitude.armed": STEPS % 2,
    "sensor_accel_0.x": 1.0 * STEPS,
    "sensor_accel_1.x": -1.0 * STEPS,
    "sensor_accel_1.count": 10**12 + STEPS,
    "attitude.timestamp": ulog.START + 200_000 * STEPS,
    "attitude.timestamp_sample": ulog.START - 3000 + 200_000 * STEPS,
}


def test_fields_of_topics_are_columns(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(log())
    found = streams(tmp_path / "a.ulg", *FIELDS)
    assert found.warnings == ()
    whole = ULog(str(tmp_path / "a.ulg"))
    for key, (time, values) in found.columns.items():
        np.testing.assert_array_equal(values, FIELDS[str(key)])
        prefix, _, field = str(key).partition(".")
        instance = int(prefix.endswith("_1"))
        # exact: divided, not multiplied by 1e-6
        np.testing.assert_array_equal(time, STEPS * (200_000 >> instance) / 1e6)
        data = whole.get_dataset(prefix.removesuffix("_0").removesuffix("_1"), instance)
        np.testing.assert_array_equal(values, data.data[field].astype(float))
        seconds = (data.data["timestamp"].astype(float) - whole.start_timestamp) / 1e6
        np.testing.assert_array_equal(time, seconds)
    assert found.units == dict.fromkeys(
        ("attitude.timestamp", "attitude.timestamp_sample"), parse_unit("us")
    )
    assert found.begins is None


@pytest.mark.parametrize("name", ["a.ulg", "a.ulog"])
def test_a_model_reads_topics_of_several_rates(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(log())
    section = f"source: {{train: {name}}}\ncolumns: {{x: 'attitude.q[0]', F: "
    data = load(tmp_path, f"{section}'attitude.q[1]'}}\n")
    np.testing.assert_array_equal(data.series["x"], STEPS)
    np.testing.assert_array_equal(data.series["F"], -STEPS)
    np.testing.assert_allclose(times(data), TIME, atol=1e-12)
    with pytest.raises(SpecError, match="E0842"):
        load(tmp_path, f"{section}sensor_accel_1.x}}\n")
    data = load(tmp_path, f"{section}sensor_accel_1.x}}\nresample: linear\n")
    np.testing.assert_allclose(data.series["F"], -2 * STEPS[:6], atol=1e-9)
    with pytest.raises(SpecError, match="E0809"):
        load(tmp_path, f"{section}'attitude.q[3]'}}\n")


def test_a_topic_of_several_instances_is_named_with_its_number(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(log())
    (fault,) = faults(tmp_path / "a.ulg", "sensor_accel.x")
    assert fault.code == "E0814"
    assert fault.help == "choose one of `sensor_accel_0.x`, `sensor_accel_1.x`"


def test_a_topic_whose_name_ends_in_a_number_is_no_instance_of_another(tmp_path: Path) -> None:
    fields = "uint64_t timestamp;float x;"
    names = ["outputs", "outputs_1", "outputs_0"]
    begin = ulog.header() + b"".join(ulog.topic_format(name, fields) for name in names)
    topics = [("outputs", 0), ("outputs", 1), ("outputs_1", 0)]
    begin += b"".join(ulog.subscription(i, name, k) for i, (name, k) in enumerate(topics))
    steps = b"".join(ulog.data(i, "Qf", ulog.START + 100, i) for i in range(3))
    (tmp_path / "a.ulg").write_bytes(begin + steps)
    found = streams(tmp_path / "a.ulg", "outputs_0.x", "outputs_1_0.x")
    assert [values.tolist() for _, values in found.columns.values()] == [[0], [2]]
    (fault,) = faults(tmp_path / "a.ulg", "outputs_1.x")
    assert fault.code == "E0814"


@pytest.mark.parametrize(
    ("key", "code", "words"),
    [
        ("attitude.q", "E0840", "it has 4 elements; choose one with `[0]`, `[1]`, …"),
        ("attitude.q[4]", "E0804", "has no column `attitude.q[4]`"),
        ("attitude.mode[0]", "E0840", "it holds text"),
        ("attitude.w", "E0804", "has no column `attitude.w`"),
        ("altitude.q[0]", "E0804", "has no column `altitude.q[0]`"),
        ("q[0]", "E0804", "has no column `q[0]`"),
        ("SYS_ID", "E0840", "it is a parameter of the vehicle, without times"),
        ("sys_name", "E0840", "it is information about the log, without times"),
    ],
)
def test_what_is_no_column_is_refused_by_name(
    tmp_path: Path, key: str, code: str, words: str
) -> None:
    (tmp_path / "a.ulg").write_bytes(log())
    (fault,) = faults(tmp_path / "a.ulg", key)
    assert (fault.code, words in fault.message) == (code, True)


def test_a_similar_field_is_advised(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(log())
    (fault,) = faults(tmp_path / "a.ulg", "attitude.Q[0]")
    assert "attitude.q[0]" in str(fault.help)


def test_a_stamp_is_the_time_of_its_topic(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(log())
    keys = ("attitude.q[0]", "sensor_accel_0.x")
    found = streams(tmp_path / "a.ulg", *keys, time="timestamp_sample")
    # in microseconds; the other topic has no such field
    np.testing.assert_array_equal(found.columns[keys[0]][0], 200_000 * STEPS - 3000)
    np.testing.assert_array_equal(found.columns[keys[1]][0], 200_000 * STEPS)
    assert set(found.time_units.values()) == {parse_unit("us")}
    section = "source: {train: a.ulg}\ncolumns: {x: 'attitude.q[0]', F: 'attitude.q[1]'}\n"
    data = load(tmp_path, f"{section}time: attitude.timestamp_sample\n")
    np.testing.assert_allclose(times(data), TIME - 0.003, atol=1e-12)


def test_a_number_is_the_time_of_one_topic(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(log())
    found = streams(tmp_path / "a.ulg", "attitude.q[0]", time="attitude.body.p")
    np.testing.assert_array_equal(found.columns["attitude.q[0]"][0], STEPS / 8)
    assert found.time_units == {}


@pytest.mark.parametrize(
    ("time", "code"),
    [
        ("nonsense", "E0804"),
        ("attitude.nonsense", "E0804"),
        ("sensor_accel_1.timestamp", "E0875"),
        ("count", "E0875"),
        ("attitude.body.p", "E0875"),
    ],
)
def test_a_time_that_topics_do_not_have_is_refused(tmp_path: Path, time: str, code: str) -> None:
    (tmp_path / "a.ulg").write_bytes(log())
    keys = ["attitude.q[0]"] if time == "count" else ["attitude.q[0]", "sensor_accel_0.x"]
    (fault,) = faults(tmp_path / "a.ulg", *keys, time=time)
    assert (fault.code, fault.span) == (code, PLACE)


def test_times_are_exact_and_may_begin_before_the_log(tmp_path: Path) -> None:
    late = (1 << 53) + 1
    messages = b"".join(ulog.data(0, "Qf", at, 1.0) for at in (late - 7, late + 1, late + 3))
    begin = ulog.header(late) + ulog.topic_format("a", "uint64_t timestamp;float x;")
    (tmp_path / "a.ulg").write_bytes(begin + ulog.subscription(0, "a") + messages)
    found = streams(tmp_path / "a.ulg", "a.x")
    assert found.columns["a.x"][0].tolist() == [-7e-6, 1e-6, 3e-6]


@pytest.mark.parametrize(
    ("fields", "layout", "time", "reason"),
    [
        ("uint64_t time;float x;", "Qf", 7, "no field `timestamp` of type `uint64_t`"),
        ("float timestamp;uint32_t a;float x;", "fIf", 7, "no field `timestamp` of type"),
        ("uint64_t timestamp;float x;", "Qf", (1 << 64) - 1, "its `timestamp` is damaged"),
    ],
)
def test_a_topic_without_usable_times_is_refused(
    tmp_path: Path, fields: str, layout: str, time: int, reason: str
) -> None:
    begin = ulog.header() + ulog.topic_format("a", fields) + ulog.subscription(0, "a")
    values = (time, 0, 1.0) if len(layout) == 3 else (time, 1.0)
    (tmp_path / "a.ulg").write_bytes(begin + ulog.data(0, layout, *values))
    (fault,) = faults(tmp_path / "a.ulg", "a.x")
    assert (fault.code, reason in fault.message) == ("E0840", True)


def test_padding_is_no_column(tmp_path: Path) -> None:
    """That at the end of a message is not written, that between fields is."""
    fields = "uint64_t timestamp;uint8_t a;uint8_t[3] _padding0;float x;uint8_t[4] _padding1;"
    begin = ulog.header() + ulog.topic_format("a", fields) + ulog.subscription(0, "a")
    (tmp_path / "a.ulg").write_bytes(begin + ulog.data(0, "QB3xf", ulog.START, 1, 2.5))
    assert streams(tmp_path / "a.ulg", "a.x").columns["a.x"][1].tolist() == [2.5]
    (fault,) = faults(tmp_path / "a.ulg", "a._padding0[0]")
    assert fault.notes == ("columns: a.timestamp, a.a, a.x",)


def test_dropouts_are_reported(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(
        BEGIN
        + SUBSCRIPTIONS
        + b"".join(map(attitude, range(5)))
        + ulog.dropout(1150)
        + b"".join(map(attitude, range(11, 16)))
        + ulog.dropout(20)
    )
    section = "source: {train: a.ulg}\ncolumns: {x: 'attitude.q[0]', F: 'attitude.q[1]'}\n"
    data = load(tmp_path, f"{section}resample: linear\n")
    (warning,) = (found for found in data.warnings if found.code == "W0837")
    assert "lost messages: 2 dropouts, 1.17 s in total" in warning.message
    assert warning.notes == ("the longest is 1.15 s, at 800 ms",)
    # nothing is read over the hole
    assert data.episodes("train").tolist() == [[0, 5], [11, 16]]
    with pytest.raises(SpecError, match="E0811"):
        load(tmp_path, section)


def test_data_that_were_appended_are_read(tmp_path: Path) -> None:
    """The log ends in the middle of a message, as where an autopilot crashes."""
    begin = ulog.header() + ulog.flags([0]) + b"".join(FORMATS)
    steps = SUBSCRIPTIONS + b"".join(map(attitude, range(6))) + attitude(6)[:20]
    end = len(begin + steps)
    begin = ulog.header() + ulog.flags([end]) + b"".join(FORMATS)
    more = ulog.subscription(9, "attitude") + b"".join(map(attitude, range(6, 12))).replace(
        struct.pack("<BH", ord("D"), 7), struct.pack("<BH", ord("D"), 9)
    )
    (tmp_path / "a.ulg").write_bytes(begin + steps + more)
    found = streams(tmp_path / "a.ulg", "attitude.q[0]")
    time, values = found.columns["attitude.q[0]"]
    np.testing.assert_array_equal(values, STEPS)
    np.testing.assert_array_equal(time, 200_000 * STEPS / 1e6)
    assert found.warnings == ()


def rescued(path: Path, fault: Diagnostic) -> Path:
    """The file that the advised command writes."""
    found = re.search(r"`python -c \"(.*)\"`", str(fault.help))
    assert found is not None
    new = path.with_name("rescued.ulg")
    command = found[1].replace("OLD.ulg", str(path)).replace("NEW.ulg", str(new))
    subprocess.run((sys.executable, "-c", command), check=True, capture_output=True)
    return new


def appended(*parts: bytes) -> bytes:
    """A log whose first part is followed by others; each but the last ends within a message."""
    begin = len(ulog.header() + ulog.flags() + b"".join(FORMATS))
    ends = np.cumsum([begin + len(parts[0]), *map(len, parts[1:-1])])
    return ulog.header() + ulog.flags([*map(int, ends)]) + b"".join(FORMATS) + b"".join(parts)


def test_an_appended_part_uses_subscriptions_of_the_parts_before(tmp_path: Path) -> None:
    """pyulog refuses these messages, and its `write_ulog` leaves them out."""
    cut = attitude(11)[:9]
    first = SUBSCRIPTIONS + b"".join(map(attitude, range(4))) + cut
    second = b"".join(map(attitude, range(4, 7))) + accel(3, 1) + cut
    content = appended(first, second, b"".join(map(attitude, range(7, 12))))
    (tmp_path / "a.ulg").write_bytes(content)
    found = streams(tmp_path / "a.ulg", "attitude.q[0]", "sensor_accel_1.x")
    np.testing.assert_array_equal(found.columns["attitude.q[0]"][1], STEPS)
    assert found.columns["sensor_accel_1.x"][1].tolist() == [-3]
    assert found.warnings == ()
    # what is not damaged in a damaged file is rescued from all parts
    (tmp_path / "a.ulg").write_bytes(content + ulog.data(99, "Qf", ulog.START, 1.0))
    (fault,) = faults(tmp_path / "a.ulg", "attitude.q[0]")
    found = streams(rescued(tmp_path / "a.ulg", fault), "attitude.q[0]")
    np.testing.assert_array_equal(found.columns["attitude.q[0]"][1], STEPS)


def test_a_number_that_a_second_subscription_uses_loses_no_messages(tmp_path: Path) -> None:
    begin = ulog.header() + ulog.flags()
    begin += b"".join(ulog.topic_format(name, "uint64_t timestamp;float x;") for name in "ab")
    content = begin
    for step, name in enumerate("abaab"):
        content += ulog.subscription(7, name) + ulog.data(7, "Qf", ulog.START + step, step)
    for path, more in (("a.ulg", b""), ("b.ulg", ulog.data(99, "Qf", ulog.START, 1.0))):
        (tmp_path / path).write_bytes(content + more)
        whole = tmp_path / path
        if more:
            (fault,) = faults(whole, "a.x")
            whole = rescued(whole, fault)
        found = streams(whole, "a.x", "b.x")
        assert found.columns["a.x"][1].tolist() == [0, 2, 3]
        assert found.columns["b.x"][1].tolist() == [1, 4]


@pytest.mark.parametrize("damage", [ulog.message("O", b"1"), ulog.data(4, "Qf", 7, 1.0)])
def test_a_message_at_which_the_library_stops_is_reported(tmp_path: Path, damage: bytes) -> None:
    """A dropout without its length, and a topic without `timestamp`; pyulog ends silently."""
    begin = BEGIN + ulog.topic_format("bare", "uint64_t time;float x;") + SUBSCRIPTIONS
    begin += ulog.subscription(4, "bare") + attitude(0) + damage
    (tmp_path / "a.ulg").write_bytes(begin + attitude(1))
    (fault,) = faults(tmp_path / "a.ulg", "attitude.q[0]")
    assert f"its message before byte {len(begin)} is damaged or has no" in fault.message
    if fault.help is not None:
        found = streams(rescued(tmp_path / "a.ulg", fault), "attitude.q[0]")
        assert found.columns["attitude.q[0]"][1].tolist() == [0]


@pytest.mark.parametrize(
    ("start", "code"),
    [
        (ulog.START - 10**6, None),
        (ulog.START + 2 * 10**6, None),
        (ulog.START + 4 * 10**6, "W0839"),
        (ulog.START + 10**15, "W0839"),
        (2 * 10**18, "E0840"),
        (1 << 63, "E0840"),
    ],
)
def test_a_start_time_that_messages_contradict_is_reported(
    tmp_path: Path, start: int, code: str | None
) -> None:
    steps = b"".join(map(attitude, range(12)))
    begin = BEGIN.replace(ulog.header(), ulog.header(start)) + SUBSCRIPTIONS
    (tmp_path / "a.ulg").write_bytes(begin + steps)
    if code == "E0840":
        (fault,) = faults(tmp_path / "a.ulg", "attitude.q[0]")
        assert (fault.code, "damaged" in fault.message) == (code, True)
        return
    found = streams(tmp_path / "a.ulg", "attitude.q[0]")
    assert [warning.code for warning in found.warnings] == ([code] if code else [])
    expected = (ulog.START - start + 200_000 * STEPS) / 1e6
    np.testing.assert_array_equal(found.columns["attitude.q[0]"][0], expected)


def test_a_start_time_of_another_clock_is_reported(tmp_path: Path) -> None:
    """Messages with times since 1970, in a log that starts 5 s after boot."""
    epoch = 17 * 10**14
    messages = b"".join(ulog.data(0, "Qf", epoch + 200_000 * i, i) for i in range(12))
    begin = ulog.header() + ulog.topic_format("a", "uint64_t timestamp;float x;")
    (tmp_path / "a.ulg").write_bytes(begin + ulog.subscription(0, "a") + messages)
    found = streams(tmp_path / "a.ulg", "a.x")
    assert [warning.code for warning in found.warnings] == ["W0839"]


def test_a_file_that_is_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    whole = log()
    last = len(accel(11, 1))
    for missing, count in ((1, 11), (last - 5, 11), (last - 3, 11), (last, 11), (last + 9, 11)):
        (tmp_path / "a.ulg").write_bytes(whole[:-missing])
        found = streams(tmp_path / "a.ulg", "sensor_accel_1.x")
        assert found.columns["sensor_accel_1.x"][1].tolist() == (-STEPS[:count]).tolist()
        codes = [warning.code for warning in found.warnings]
        # a message ends there
        assert codes == ([] if missing == last else ["W0838"])


def test_messages_of_a_later_version_are_passed_over_and_said(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(log(ulog.message("Z", b"new") + ulog.message("Z", b"newer")))
    found = streams(tmp_path / "a.ulg", "attitude.q[0]")
    (warning,) = found.warnings
    assert warning.code == "W0838"
    assert "2 messages are of a kind that ULog does not define: `Z`" in warning.message


@pytest.mark.parametrize(
    "damaged",
    [
        # without a subscription, too short, too long, of no kind
        log(ulog.data(99, "Qf", ulog.START, 1.0)),
        log(ulog.data(2, "Qf", ulog.START, 1.0)),
        log(ulog.data(2, "QfQQ", ulog.START, 1.0, 0, 0)),
        log(bytes(40)),
        # a subscription without a format, and one whose format is broken
        log(ulog.subscription(9, "nowhere")),
        BEGIN + ulog.topic_format("b", "float[x] y;") + SUBSCRIPTIONS + attitude(0),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, damaged: bytes) -> None:
    """pyulog passes over what is damaged, and prints so at most."""
    (tmp_path / "a.ulg").write_bytes(damaged)
    (fault,) = faults(tmp_path / "a.ulg", "attitude.q[0]")
    assert (fault.code, "parts of it are no messages" in fault.message) == ("E0802", True)
    found = streams(rescued(tmp_path / "a.ulg", fault), "attitude.q[0]")
    count = len(found.columns["attitude.q[0]"][1])
    np.testing.assert_array_equal(found.columns["attitude.q[0]"][1], STEPS[:count])


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "Header too short"),
        (b"ULog" + bytes(60), "Failed to parse header"),
        (
            ulog.header() + ulog.flags()[:11] + bytes([2]) + ulog.flags()[12:],
            "Unknown incompatible flag",
        ),
        (BEGIN.replace(b"double p", b"rates pp") + SUBSCRIPTIONS, "recursion depth"),
    ],
)
def test_what_is_no_log_is_unreadable(tmp_path: Path, content: bytes, reason: str) -> None:
    (tmp_path / "a.ulg").write_bytes(content)
    (fault,) = faults(tmp_path / "a.ulg", "attitude.q[0]")
    assert (fault.code, reason in fault.message) == ("E0802", True)


def test_a_format_that_unfolds_to_billions_of_fields_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(isolation, "_MEMORY", 1 << 26)
    formats = b"".join(
        ulog.topic_format(f"t{i}", f"uint64_t timestamp;t{i + 1}[999] a;") for i in range(5)
    )
    content = ulog.header() + formats + ulog.topic_format("t5", "float x;")
    (tmp_path / "a.ulg").write_bytes(content + ulog.subscription(0, "t0"))
    (fault,) = faults(tmp_path / "a.ulg", "t0.timestamp")
    assert fault.code == "E0802"


def test_no_damage_raises_anything_but_a_message(tmp_path: Path) -> None:
    whole = log()
    seen: set[str] = set()
    for seed in range(12):
        generator, damaged = random.Random(seed), bytearray(whole)
        for _ in range(5):
            damaged[generator.randrange(len(whole))] = generator.randrange(256)
        (tmp_path / "b.ulg").write_bytes(damaged)
        wanted = WantedColumns({"attitude.q[0]": "`x`", "sensor_accel_1.x": "`F`"})
        try:
            format_of("b.ulg").reader(tmp_path / "b.ulg", "b.ulg", wanted, Dialect())
        except SpecError as error:
            seen |= {fault.code for fault in error.diagnostics}
    assert "E0802" in seen
    assert seen <= {"E0802", "E0804", "E0810", "E0840"}
