"""Sine, cosine, atan2, exp and cube root, so that every build of the firmware computes the same bits.

The functions of two C libraries differ in the last bit. The functions here use only additions,
multiplications, divisions and comparisons, which IEEE 754 defines to the bit; sqrt is used only to compute
exact powers of two. Polynomials and reductions: fdlibm (Sun Microsystems, 1993; public), without its bit
operations. Sine, cosine, exp and the cube root are within 1 unit in the last place of the true value, atan2
within 1.5; tests check these bounds. NaN gives NaN, and no argument raises.
"""

import math

from firmware_py.core.numbers import TO_INTEGER, wrap_pi

LARGEST_EXACT_RAD = 100.0
"""Larger angles are wrapped by `wrap_pi` first, with an error of |angle| · 2⁻⁵²; to 0 beyond 10⁹ rad."""

_QUARTER_TURNS_A_RAD = 6.36619772367581382433e-01
# π/2: two pieces of 33 bits, whose products with up to 64 quarter turns are exact, and the remainder.
_QUARTER_1, _QUARTER_2, _QUARTER_REST = (
    1.57079632673412561417e00,
    6.07710050630396597660e-11,
    2.02226624879595063154e-21,
)
_S1, _S2, _S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S4, _S5, _S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
_C1, _C2, _C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C4, _C5, _C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11
_A0, _A1, _A2 = 3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01
_A3, _A4, _A5 = -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02
_A6, _A7, _A8 = 6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02
_A9, _A10 = -3.65315727442169155270e-02, 1.62858201153657823623e-02
_PI_REST, _HALF_PI_REST = 1.2246467991473531772e-16, 6.12323399573676603587e-17
_QUARTER_PI_REST = 3.06161699786838301793e-17
_ATAN_1_2, _ATAN_1_2_REST = 4.63647609000806093515e-01, 2.26987774529616870924e-17
_ATAN_3_2, _ATAN_3_2_REST = 9.82793723247329054082e-01, 1.39033110312309984516e-17
_P1, _P2, _P3 = 1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05
_P4, _P5 = -1.65339022054652515390e-06, 4.13813679705723846039e-08
_LN2, _LN2_REST = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_LOWEST_EXPONENT, _HIGHEST_EXPONENT = -708.0, 709.0
_LARGEST_STEP = 1.157920892373162e77
"""2²⁵⁶."""
_HALF = 134217729.0
"""2²⁷ + 1: factor that splits a number into two halves of its bits (Veltkamp)."""


def _sine(x: float, tail: float) -> float:
    """Sine of x + tail within ±π/4."""
    z = x * x
    cube = z * x
    series = _S2 + z * (_S3 + z * _S4) + z * (z * z) * (_S5 + z * _S6)
    return x - ((z * (0.5 * tail - cube * series) - tail) - cube * _S1)


def _cosine(x: float, tail: float) -> float:
    """Cosine of x + tail within ±π/4."""
    z = x * x
    square = z * z
    series = z * (_C1 + z * (_C2 + z * _C3)) + square * square * (_C4 + z * (_C5 + z * _C6))
    half = 0.5 * z
    rest = 1.0 - half
    return rest + (((1.0 - rest) - half) + (z * series - x * tail))


def sine_cosine(angle_rad: float) -> tuple[float, float]:
    """Sine and cosine; an angle beyond `LARGEST_EXACT_RAD` is wrapped first, to 0 beyond 10⁹ rad."""
    angle = angle_rad
    if not -LARGEST_EXACT_RAD <= angle <= LARGEST_EXACT_RAD:
        if math.isnan(angle):
            return angle, angle
        angle = wrap_pi(angle)
    # The angle minus whole quarter turns, within ±π/4, is near + tail.
    turns = (angle * _QUARTER_TURNS_A_RAD + TO_INTEGER) - TO_INTEGER
    first = angle - turns * _QUARTER_1
    step = turns * _QUARTER_2
    second = first - step
    rest = turns * _QUARTER_REST - ((first - second) - step)
    near = second - rest
    tail = (second - near) - rest
    sine, cosine = _sine(near, tail), _cosine(near, tail)
    quarter = turns - 4.0 * ((0.25 * turns + TO_INTEGER) - TO_INTEGER)
    if quarter == 0.0:
        return sine, cosine
    if quarter == 1.0:
        return cosine, -sine
    if quarter == -1.0:
        return -cosine, sine
    return -sine, -cosine


def sin(angle_rad: float) -> float:
    """Sine; see `sine_cosine`."""
    return sine_cosine(angle_rad)[0]


def _arctangent(ratio: float) -> float:
    """Arctangent of a ratio ≥ 0: atan(a) + atan((ratio − a)/(1 + a ratio)) with a near the ratio."""
    high, low = 0.0, 0.0
    x = ratio
    if ratio >= 2.4375:
        high, low, x = 0.5 * math.pi, _HALF_PI_REST, -1.0 / ratio
    elif ratio >= 1.1875:
        high, low, x = _ATAN_3_2, _ATAN_3_2_REST, (ratio - 1.5) / (1.0 + 1.5 * ratio)
    elif ratio >= 0.6875:
        high, low, x = 0.25 * math.pi, _QUARTER_PI_REST, (ratio - 1.0) / (ratio + 1.0)
    elif ratio >= 0.4375:
        high, low, x = _ATAN_1_2, _ATAN_1_2_REST, (2.0 * ratio - 1.0) / (2.0 + ratio)
    z = x * x
    w = z * z
    odd = z * (_A0 + w * (_A2 + w * (_A4 + w * (_A6 + w * (_A8 + w * _A10)))))
    even = w * (_A1 + w * (_A3 + w * (_A5 + w * (_A7 + w * _A9))))
    return high - ((x * (odd + even) - low) - x)


def atan2(y: float, x: float) -> float:
    """The angle of (x, y) in [−π, π]; the sign of a zero is ignored, and (0, 0) gives 0."""
    if math.isnan(x) or math.isnan(y):
        return math.nan
    across, along = abs(y), abs(x)
    if across == 0.0:
        angle = 0.0
    elif along == 0.0:
        angle = 0.5 * math.pi
    else:  # two infinities count as equal
        angle = _arctangent(1.0 if across == along else across / along)
    if x < 0.0:
        angle = math.pi - (angle - _PI_REST)
    return -angle if y < 0.0 else angle


def exp(x: float) -> float:
    """eˣ; 0 below −708 and infinite above 709, near the ends of the range of a double."""
    if not _LOWEST_EXPONENT <= x <= _HIGHEST_EXPONENT:
        if math.isnan(x):
            return x
        return 0.0 if x < 0.0 else math.inf
    doublings = (x / _LN2 + TO_INTEGER) - TO_INTEGER
    high, low = x - doublings * _LN2, doublings * _LN2_REST
    near = high - low
    z = near * near
    c = near - z * (_P1 + z * (_P2 + z * (_P3 + z * (_P4 + z * _P5))))
    result = 1.0 - ((low - near * c / (2.0 - c)) - high)
    factor, left = (2.0, int(doublings)) if doublings >= 0.0 else (0.5, int(-doublings))
    for _ in range(10):
        if left & 1:
            result *= factor
        factor *= factor
        left >>= 1
    return result


def cube_root(x: float) -> float:
    """The real cube root; the cube root of an infinity is that infinity."""
    if not 0.0 < abs(x) < math.inf:
        return x
    near, scale, step = abs(x), 1.0, _LARGEST_STEP
    is_large = near >= 1.0
    for _ in range(9):  # scale near into [1, 8): step is 2²⁵⁶, 2¹²⁸, … 2
        cube = step * step * step
        if is_large and near >= cube:
            near /= cube
            scale *= step
        elif not is_large and near * cube < 8.0:
            near *= cube
            scale /= step
        step = math.sqrt(step)
    root = 0.75117 + 0.30183 * near - 0.019 * near * near
    for _ in range(2):  # Halley
        cube = root * root * root
        root *= (cube + 2.0 * near) / (2.0 * cube + near)
    split = root * _HALF
    root = split - (split - root)  # 26 bits: its square is exact
    ratio = near / (root * root)
    root += root * ((ratio - root) / (root + root + ratio))
    return root * scale if x > 0.0 else -root * scale
