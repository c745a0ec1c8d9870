"""Where the firmware's bytes are, and that looking changes none of them."""

import json
from pathlib import Path

import llvmlite.binding as llvm
import pytest

from firmware_py.builds.flat import layout
from firmware_py.builds.machine_code import TARGETS, retargeted, sizes
from firmware_py.node.tick import NodeState
from tools import cli
from tools.size_map import PLACELESS, blocks, bytes_by_file, line_table, size_map, with_lines

ASSEMBLY = """
define void @_ZN11firmware_py4core7numbers5firstB2v1(ptr %a) noinline {
  store volatile i32 1, ptr %a
  ret void
}
define void @_ZN11firmware_py4core10elementary6secondB2v1(ptr %a) alwaysinline {
  store volatile i32 2, ptr %a
  store volatile i32 3, ptr %a
  ret void
}
define i32 @entry(ptr %a, i32 %b) {
  switch i32 %b, label %other [
    i32 7, label %seven
    i32 9, label %other
  ]
seven:
  call void @_ZN11firmware_py4core7numbers5firstB2v1(
    ptr %a)
  ret i32 %b
other:
  call void @_ZN11firmware_py4core10elementary6secondB2v1(ptr %a)
  ret i32 5
}
!0 = !{i1 true}
"""


def text_of(code: bytes) -> bytes:
    """The machine code of an object file."""
    return b"".join(
        bytes(section.data())
        for section in llvm.ObjectFileRef.from_data(code).sections()
        if section.is_text()
    )


def test_each_byte_of_code_is_of_one_module_wherever_it_was_inlined() -> None:
    target = TARGETS["cortex-m4f"]
    plain = text_of(retargeted(ASSEMBLY, target, ["entry"]))
    lined = retargeted(with_lines(ASSEMBLY), target, ["entry"])
    assert text_of(lined) == plain
    found = bytes_by_file(line_table(lined))
    assert set(found) - {PLACELESS} == {"core.numbers", "core.elementary", "entry"}
    assert sum(found.values()) == len(plain)
    assert found["core.numbers"] == 6
    assert found["core.elementary"] == 8


def test_blocks_fill_a_record() -> None:
    state = layout(NodeState, "single")
    assert sum(blocks(state).values()) == state.itemsize
    assert blocks(state)["ticks"] == 8


def test_the_map_holds_all_bytes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        cli.run(["firmware", "build", "--target", "cortex-m4f", "--out", str(tmp_path / "b"), "--json"]) == 0
    )
    printed = json.loads(capsys.readouterr().out)
    found = printed["map"]
    assert found == size_map("cortex-m4f")
    assert printed["bytes"] == sizes("cortex-m4f")
    assert printed["bytes"]["code"] - sum(found["code"].values()) in range(64)  # what aligns functions
    for part in ("config", "state"):
        assert sum(found[part].values()) == printed["bytes"][part]
    for module in (
        "core.estimation.estimator",
        "interface.arrivals",
        "core.elementary",
        "interface.generated.unpacking",
    ):
        assert 200 < found["code"][module] < 20_000
    assert "float x_m;" in (tmp_path / "b" / "vibro_firmware.h").read_text()
