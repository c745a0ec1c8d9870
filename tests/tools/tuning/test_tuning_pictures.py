"""Pictures of tunings: what they were given is in them."""

from matplotlib.figure import Figure

from tools.tuning.pictures import Panel, draw_panels


def test_every_line_is_drawn_and_differs_from_the_others() -> None:
    lines = {f"approach {number}": ((1.0, 2.0), (0.0, float(number))) for number in range(6)}
    figure = Figure()
    draw_panels(figure, [Panel("rise [s]", name, lines, None, 1.5) for name in ("starts", "energy")])
    drawn = [line for line in figure.axes[0].get_lines() if line.get_marker() == "o"]
    assert len({(line.get_color(), line.get_linestyle()) for line in drawn}) == len(lines)
