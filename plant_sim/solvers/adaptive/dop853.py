"""A step of DOP853 with its error and its continuous extension, for the equations of `motion`.

Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed. 1993, sections II.5, 6 and 10. A
test compares the numbers with scipy's; importing scipy's would take as long as the motion of a run.
"""
# ruff: noqa: E501

import math

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.kernels import subroutine
from plant_sim.solvers.adaptive.motion import derivative
from plant_sim.solvers.adaptive.state_layout import STAGES, Flow, Run
from plant_sim.solvers.bernstein import DEGREE


def _table(text: str) -> FloatArray:
    return np.array([line.split() for line in text.strip().splitlines()], float)


A = _table("""
0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0
0.05260015195876773 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0
0.0197250569845379 0.0591751709536137 0 0 0 0 0 0 0 0 0 0 0 0 0 0
0.02958758547680685 0 0.08876275643042054 0 0 0 0 0 0 0 0 0 0 0 0 0
0.2413651341592667 0 -0.8845494793282861 0.924834003261792 0 0 0 0 0 0 0 0 0 0 0 0
0.037037037037037035 0 0 0.17082860872947386 0.12546768756682242 0 0 0 0 0 0 0 0 0 0 0
0.037109375 0 0 0.17025221101954405 0.06021653898045596 -0.017578125 0 0 0 0 0 0 0 0 0 0
0.03709200011850479 0 0 0.17038392571223998 0.10726203044637328 -0.015319437748624402 0.008273789163814023 0 0 0 0 0 0 0 0 0
0.6241109587160757 0 0 -3.3608926294469414 -0.868219346841726 27.59209969944671 20.154067550477894 -43.48988418106996 0 0 0 0 0 0 0 0
0.47766253643826434 0 0 -2.4881146199716677 -0.590290826836843 21.230051448181193 15.279233632882423 -33.28821096898486 -0.020331201708508627 0 0 0 0 0 0 0
-0.9371424300859873 0 0 5.186372428844064 1.0914373489967295 -8.149787010746927 -18.52006565999696 22.739487099350505 2.4936055526796523 -3.0467644718982196 0 0 0 0 0 0
2.273310147516538 0 0 -10.53449546673725 -2.0008720582248625 -17.9589318631188 27.94888452941996 -2.8589982771350235 -8.87285693353063 12.360567175794303 0.6433927460157636 0 0 0 0 0
0.054293734116568765 0 0 0 0 4.450312892752409 1.8915178993145003 -5.801203960010585 0.3111643669578199 -0.1521609496625161 0.20136540080403034 0.04471061572777259 0 0 0 0
0.056167502283047954 0 0 0 0 0 0.25350021021662483 -0.2462390374708025 -0.12419142326381637 0.15329179827876568 0.00820105229563469 0.007567897660545699 -0.008298 0 0 0
0.03183464816350214 0 0 0 0 0.028300909672366776 0.053541988307438566 -0.05492374857139099 0 0 -0.00010834732869724932 0.0003825710908356584 -0.00034046500868740456 0.1413124436746325 0 0
-0.42889630158379194 0 0 0 0 -4.697621415361164 7.683421196062599 4.06898981839711 0.3567271874552811 0 0 0 -0.0013990241651590145 2.9475147891527724 -9.15095847217987 0
""")
"""Weights of the slopes: twelve stages, the step itself, three more stages for the continuous extension."""

C = _table("""
0 0.05260015195876773 0.0789002279381516 0.1183503419072274 0.2816496580927726 0.3333333333333333 0.25 0.3076923076923077 0.6512820512820513 0.6 0.8571428571428571 1.0 1.0 0.1 0.2 0.7777777777777778
""")[0]
"""Times of the stages, as shares of the step."""

E3, E5 = _table("""
-0.18980075407240762 0 0 0 0 4.450312892752409 1.8915178993145003 -5.801203960010585 -0.4226823213237919 -0.1521609496625161 0.20136540080403034 0.02265179219836082 0
0.01312004499419488 0 0 0 0 -1.2251564463762044 -0.4957589496572502 1.6643771824549864 -0.35032884874997366 0.3341791187130175 0.08192320648511571 -0.022355307863886294 0
""")
"""Weights of the error estimates of third and fifth order."""

D = _table("""
-8.428938276109013 0 0 0 0 0.5667149535193777 -3.0689499459498917 2.38466765651207 2.117034582445028 -0.871391583777973 2.2404374302607883 0.6315787787694688 -0.08899033645133331 18.148505520854727 -9.194632392478356 -4.436036387594894
10.427508642579134 0 0 0 0 242.28349177525817 165.20045171727028 -374.5467547226902 -22.113666853125306 7.733432668472264 -30.674084731089398 -9.332130526430229 15.697238121770845 -31.139403219565178 -9.35292435884448 35.81684148639408
19.985053242002433 0 0 0 0 -387.0373087493518 -189.17813819516758 527.8081592054236 -11.57390253995963 6.8812326946963 -1.0006050966910838 0.7777137798053443 -2.778205752353508 -60.19669523126412 84.32040550667716 11.99229113618279
-25.69393346270375 0 0 0 0 -154.18974869023643 -231.5293791760455 357.6391179106141 93.40532418362432 -37.45832313645163 104.0996495089623 29.8402934266605 -43.53345659001114 96.32455395918828 -39.17726167561544 -149.72683625798564
""")
"""Weights of the continuous extension."""


@subroutine(inline=True)
def attempt(run: Run, flow: Flow, h_s: float, scale: FloatArray) -> float:
    """Step from `memory.y` to `memory.new`; return the error, relative to the tolerance `scale`. `k[0]` is the
    derivative at `y`.
    """
    parts, memory = run.parts, run.memory[0]
    progress, places, k = memory.progress, memory.places, memory.slopes
    y, trial, new = memory.all_y, memory.all_trial, memory.all_new
    for stage in range(1, 12):
        for index in range(progress.motion):  # the integrals feed back into nothing
            i = places[index]
            trial[i] = y[i] + h_s * _slope(k, stage, 1 if stage < 5 else 3, i)
        derivative(parts, flow, C[stage] * h_s, memory.trial, k[stage])
    fifth, third = 0.0, 0.0
    for index in range(progress.used):
        i = places[index]
        new[i] = y[i] + h_s * _slope(k, 12, 5, i)
        e5 = E5[0] * k[0, i]
        e3 = E3[0] * k[0, i]
        for j in range(5, 12):
            e5 += E5[j] * k[j, i]
            e3 += E3[j] * k[j, i]
        fifth += (e5 / scale[i]) ** 2
        third += (e3 / scale[i]) ** 2
    if fifth == 0.0:
        return 0.0
    return abs(h_s) * fifth / math.sqrt((fifth + 0.01 * third) * progress.used)


@subroutine(inline=True)
def _slope(k: FloatArray, stage: int, first: int, i: int) -> float:
    """Σ a_j k_j of one quantity; the row of A holds zeros in columns 1 to `first` − 1."""
    total: float = A[stage, 0] * k[0, i]
    for j in range(first, stage):
        total += A[stage, j] * k[j, i]
    return total


@subroutine
def extend(run: Run, flow: Flow, h_s: float) -> None:
    """Bernstein coefficients of the motion over the step, into `memory.dense`."""
    parts, memory = run.parts, run.memory[0]
    k, dense, places = memory.slopes, memory.dense, memory.places
    y, trial, new, motion = memory.all_y, memory.all_trial, memory.all_new, memory.progress.motion
    derivative(parts, flow, h_s, memory.new, k[12])
    for stage in range(13, STAGES):
        for index in range(motion):
            i = places[index]
            trial[i] = y[i] + h_s * _slope(k, stage, 5, i)
        derivative(parts, flow, C[stage] * h_s, memory.trial, k[stage])
    for index in range(motion):
        i = places[index]
        b = dense[i]
        rise = new[i] - y[i]
        # y0 + s (F0 + (1 − s)(F1 + s (F2 + (1 − s)(F3 + s (F4 + (1 − s)(F5 + s F6))))))
        b[0] = _extension_term(h_s, k, 3, i)
        _times_s(b, 0)
        _add(b, 1, _extension_term(h_s, k, 2, i))
        _times_one_minus_s(b, 1)
        _add(b, 2, _extension_term(h_s, k, 1, i))
        _times_s(b, 2)
        _add(b, 3, _extension_term(h_s, k, 0, i))
        _times_one_minus_s(b, 3)
        _add(b, 4, 2.0 * rise - h_s * (k[12, i] + k[0, i]))
        _times_s(b, 4)
        _add(b, 5, h_s * k[0, i] - rise)
        _times_one_minus_s(b, 5)
        _add(b, 6, rise)
        _times_s(b, 6)
        _add(b, DEGREE, y[i])


@subroutine
def _extension_term(h_s: float, k: FloatArray, row: int, i: int) -> float:
    total: float = D[row, 0] * k[0, i]
    for j in range(5, STAGES):
        total += D[row, j] * k[j, i]
    return h_s * total


@subroutine
def _add(b: FloatArray, degree: int, constant: float) -> None:
    for j in range(degree + 1):
        b[j] += constant


@subroutine
def _times_s(b: FloatArray, degree: int) -> None:
    """s p(s), one degree higher: c_j = j b_(j−1) / (n + 1)."""
    for j in range(degree + 1, 0, -1):
        b[j] = j * b[j - 1] / (degree + 1)
    b[0] = 0.0


@subroutine
def _times_one_minus_s(b: FloatArray, degree: int) -> None:
    """(1 − s) p(s), one degree higher: c_j = (n + 1 − j) b_j / (n + 1)."""
    b[degree + 1] = 0.0
    for j in range(degree + 1):
        b[j] = (degree + 1 - j) * b[j] / (degree + 1)
