"""Which branches of the firmware no scenario reaches."""

from pathlib import Path

from tools.dev.coverage import FIRMWARE, Branch, missed

PATH = FIRMWARE / "core" / "numbers.py"


def test_a_report_s_missing_branches_are_listed_with_their_source() -> None:
    line = next(
        number
        for number, text in enumerate(PATH.read_text(encoding="utf-8").splitlines(), 1)
        if text.strip().startswith("if ")
    )
    report = {
        "files": {
            str(PATH): {"missing_branches": [[line, line + 1], [line, -line]]},
            str(FIRMWARE / "core" / "step.py"): {"missing_branches": []},
        }
    }
    found = list(missed(report))
    assert found == [Branch(PATH, line, line + 1), Branch(PATH, line, -line)]
    where = Path("firmware_py", "core", "numbers.py")
    assert str(found[0]).startswith(f"{where}:{line}: never to line {line + 1}: if ")
    assert f"{where}:{line}: never to the end: if " in str(found[1])
