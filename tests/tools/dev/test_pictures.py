"""The pictures of the explanations: each is there, and shown on the page of its name."""

import numpy as np
import pytest

from tools.dev import pictures
from tools.dev.pictures import AVERAGED_TICKS, Series

DRAWINGS = {"mechanism": "model", "gait-cycle": "gait"}
"""Drawings made by hand, and the page of each."""
ON_PAGE = dict(zip(pictures.PICTURES, pictures.PICTURES, strict=True)) | DRAWINGS


@pytest.mark.parametrize("name", ON_PAGE)
def test_every_picture_is_on_its_page(name):
    assert (pictures.PLACE / f"{name}.svg").read_text("utf-8").startswith("<?xml")
    assert f"]({name}.svg)" in (pictures.PLACE / f"{ON_PAGE[name]}.md").read_text("utf-8")


def test_a_mean_is_of_the_second_before():
    t_s = 1e-3 * np.arange(3 * AVERAGED_TICKS)
    mean = pictures.averaged(Series(t_s, np.where(t_s < 0.9995, 0.0, 2.0)))
    assert mean.t_s[0] == pytest.approx(0.999)
    assert mean.values[0] == 0.0
    assert mean.values[AVERAGED_TICKS // 2] == pytest.approx(1.0)
    assert mean.values[-1] == pytest.approx(2.0)


def test_a_close_up_is_of_its_interval():
    t_s = 1e-3 * np.arange(1000)
    kept = pictures.within(Series(t_s, t_s), (0.2, 0.4))
    assert kept.t_s[0] == pytest.approx(0.2)
    assert kept.t_s[-1] == pytest.approx(0.4)
