"""Makes docs/pictures/default-run.png, the README's picture: what `make hil` and then `make view` show.

    python -m tools.dev.run_picture [RUN]

Shows the first tab of the default run's log: of this run folder, or of a new run in real time. It needs a
Vulkan driver, such as mesa-vulkan-drivers. The picture carries the entities of its views, which a test
compares with the layout.
"""

import argparse
import io
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import rerun.blueprint as rrb
from PIL import Image, PngImagePlugin
from rerun.experimental import ViewerClient

from hil.record.rrd.rerun_program import rerun_environment
from hil.run_files import RunFile
from hil.runs.bench import run_scenario
from hil.runs.job import RunOptions, silent
from hil.scenario.scenario import load_scenario
from hil.show.layout import Contents, Highlights, layout
from hil.show.legible.limits import FIGURES, limits_of
from hil.show.window import LOOPBACK, free_port, put_cursor, viewer_command

PICTURE = Path(__file__).parents[2] / "docs/pictures/default-run.png"
SCENARIO = "soft-start-multistable"
ENTITIES = "entities"
"""Key of the views' entities among the picture's texts."""
MENU = 36
"""Height in pixels of the viewer's menu, which is cut off."""
CURSOR_S = 6.2
"""Time of the cursor: between two impacts."""


def entities_of(part: Any) -> dict[str, list[str]]:
    """The entities of every view below a part of a layout, by the views' names."""
    if isinstance(part, rrb.Container):
        return {name: found for inner in part.contents for name, found in entities_of(inner).items()}
    contents = part.contents if isinstance(part.contents, list) else [part.origin]
    return {str(part.name): sorted(str(entity) for entity in contents)}


def draw_log(log: Path) -> Image.Image:
    """A log as the viewer opens it, once two screenshots are equal, so that all is loaded."""
    port = free_port()
    command = [*viewer_command(log, port=port), "--headless"]
    with subprocess.Popen(command, env=rerun_environment(), stderr=subprocess.DEVNULL) as viewer:
        try:
            url = f"rerun+http://{LOOPBACK}:{port}/proxy"
            put_cursor(url, CURSOR_S, viewer)
            shots = [b"", (client := ViewerClient.connect(url)).take_screenshot()]
            while shots[-1] != shots[-2]:
                shots.append(client.take_screenshot())
        finally:
            viewer.terminate()
    return Image.open(io.BytesIO(shots[-1])).convert("RGB")


def overview_entities() -> dict[str, list[str]]:
    """The entities of each view in the first tab of the default run's log, by the scenario's checks."""
    checks = load_scenario(SCENARIO).checks
    limited = tuple(entity for entity, figures in FIGURES.items() if limits_of(checks, figures))
    contents = Contents(judged=True, refused=False, limited=limited)
    tabs: Any = layout(Highlights((0.0, 1.0), (0.0, 1.0)), contents).root_container
    return entities_of(tabs.contents[0])


def main() -> None:
    """Make the picture of a run folder, or of a new run."""
    parser = argparse.ArgumentParser(prog="python -m tools.dev.run_picture", description=__doc__)
    parser.add_argument("run", nargs="?", type=Path, help="folder of a run of the default scenario")
    given = parser.parse_args().run
    with tempfile.TemporaryDirectory() as folder:
        run_dir = given or Path(folder) / "run"
        if given is None:
            run_scenario(load_scenario(SCENARIO), RunOptions(clock="real"), run_dir, 1, silent)
        whole = draw_log(run_dir / RunFile.LOG)
    cut = whole.crop((0, MENU, whole.width, whole.height))
    about = PngImagePlugin.PngInfo()
    about.add_text(ENTITIES, json.dumps(overview_entities(), sort_keys=True))
    cut.resize((1400, round(1400 * cut.height / cut.width))).save(PICTURE, pnginfo=about, optimize=True)


if __name__ == "__main__":
    main()
