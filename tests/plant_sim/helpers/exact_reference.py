"""An independent exact simulation to hold the solver against: slow, plain and in more digits.

The motion is a sum of complex exponentials in the roots of the characteristic polynomial; events are found on
a dense grid whose every extremum is examined, then by bisection. 40 digits with mpmath, 19 with long doubles.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath
import numpy as np

from plant_sim.parts.friction import Coulomb, Viscous
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import RigidStop

Number = Any
Guard = Callable[[Number], Number]
Motion = Callable[[Number], tuple[Number, Number]]

FINEST, COARSE_AFTER_RELEASE, COARSE_ON_STOP = 40, 16, 10
LEAST_BOUNCE_M_S = 1e-8


class Mpmath:
    """40 digits; one value at a time."""

    tiny = mpmath.mpf(10) ** -38
    bisections = 130
    number = staticmethod(mpmath.mpf)
    exp = staticmethod(mpmath.exp)
    sqrt = staticmethod(mpmath.sqrt)
    complex = staticmethod(mpmath.mpc)

    @staticmethod
    def values(function: Guard, grid: list[Number]) -> list[Number]:
        return [function(h) for h in grid]


class LongDouble:
    """19 digits; whole arrays at a time."""

    tiny = np.longdouble(1e-19)
    bisections = 66
    number = staticmethod(np.longdouble)
    exp = staticmethod(np.exp)
    sqrt = staticmethod(np.sqrt)

    @staticmethod
    def complex(re: Number, im: Number) -> Number:
        return np.clongdouble(re) + np.clongdouble(1j) * im

    @staticmethod
    def values(function: Guard, grid: list[Number]) -> list[Number]:
        return list(function(np.array(grid, dtype=np.longdouble)))


class Impact(NamedTuple):
    t_s: Number
    v_m_s: Number


class Reference:
    """One scene; `run` returns its impacts."""

    def __init__(self, parts: Parts, arithmetic: Any, grid_per_period: int = 40) -> None:
        a = self.arithmetic = arithmetic
        m, c = a.number(parts.striker.mass_kg), a.number(parts.striker.spring_n_per_m)
        b = a.number(parts.friction.b_n_s_m) if isinstance(parts.friction, Viscous | Coulomb) else a.number(0)
        mu = a.number(parts.friction.mu) if isinstance(parts.friction, Coulomb) else a.number(0)
        self.w2, self.sigma = c / m, b / (2 * m)
        self.held = mu * a.number(parts.striker.gravity_m_s2) / self.w2
        self.A, self.Omega = a.number(parts.drive.amplitude_m), a.number(parts.drive.omega_rad_s)
        root = a.sqrt(a.complex(self.sigma**2 - self.w2, a.number(0)))
        if abs(root) < a.tiny:
            root = a.complex(a.tiny, a.number(0))
        self.l1, self.l2 = -self.sigma + root, -self.sigma - root
        self.i = a.complex(a.number(0), a.number(1))
        detune = self.w2 - self.Omega**2 + self.i * (2 * self.sigma * self.Omega)
        self.G = self.w2 * self.A / (detune if abs(detune) > a.tiny else a.tiny)
        self.gap, self.k = None, a.number(0)
        if isinstance(parts.stop, RigidStop):
            self.gap = a.number(parts.stop.position_m) - a.number(parts.striker.rest_length_m)
            self.k = a.number(parts.stop.restitution)
        fastest = max(float(self.w2) ** 0.5, float(self.Omega))
        self.step = a.number(2 * np.pi / fastest / grid_per_period)

    def run(self, y: Number, v: Number, crank: float, until_s: float, most: int = 10**9) -> list[Impact]:
        """Impacts from t = 0 on, at most `most`."""
        a = self.arithmetic
        self.crank, self.end = a.number(crank), a.number(until_s)
        self.t, self.y, self.v = a.number(0), a.number(y), a.number(v)
        self.mode: str | None = None  # what an exit leads to, where rounding could not decide
        self.blind = FINEST  # halvings of the grid's step that a guard is looked at from
        self.impacts: list[Impact] = []
        going = True
        while going and len(self.impacts) < most:
            going = self._next()
        return self.impacts

    def _next(self) -> bool:
        at_stop = self.gap is not None and self.y >= self.gap
        push = self._push(self.t)
        still = self.v == 0 and self.mode is None
        if self.mode == "rest" or (still and at_stop and push > self.held):
            return self._rest()
        if self.mode == "stick" or (still and self.held > 0 and abs(push) <= self.held):
            return self._stick(at_stop)
        if at_stop and self.v > 0:
            self._hit()
            return True
        return self._fly(at_stop, push)

    def _push(self, t: Number) -> Number:
        """Spring force over c at the present place."""
        a = self.arithmetic
        return self.A * a.exp(self.i * (self.crank + self.Omega * t)).imag - self.y

    def _rest(self) -> bool:
        h = self._first_root(lambda h: self.held - self._push(self.t + h), self.end - self.t)
        if h is None:
            return False
        self.t += h
        self.mode = "stick" if self.held > 0 else None
        if self.mode is None:
            self._send_off(-1)
        return True

    def _stick(self, at_stop: bool) -> bool:
        left = self.end - self.t
        up = self._first_root(lambda h: self._push(self.t + h) - self.held, left)
        down = self._first_root(lambda h: -self._push(self.t + h) - self.held, left)
        exits = [h for h in (up, down) if h is not None]
        if not exits:
            return False
        h = min(exits)
        self.t += h
        self.mode = "rest" if h == up and at_stop else None
        if self.mode is None:
            self._send_off(1 if h == up else -1)
        return True

    def _send_off(self, sign: int) -> None:
        """Released with next to nothing, below the rounding of y' for a while."""
        self.v, self.blind = sign * self.arithmetic.tiny, COARSE_AFTER_RELEASE

    def _fly(self, at_stop: bool, push: Number) -> bool:
        a = self.arithmetic
        sign = 0
        if self.held > 0:
            sign = 1 if self.v > 0 or (self.v == 0 and push > 0) else -1
        motion = self._flight(self.y, self.v, self.crank + self.Omega * self.t, sign)
        turn, hit, left, blind = None, None, self.end - self.t, self.blind
        self.blind = FINEST
        if sign:
            turn = self._first_root(lambda h: -sign * motion(h)[1], left, blind)
        if self.gap is not None:
            if at_stop:  # look from where the way back is above rounding
                fast = self.v != 0 and blind == FINEST
                blind = COARSE_ON_STOP
                if fast:
                    blind = min(FINEST, int(np.log2(float(self.step * abs(self.v)) / 2e-18)))
            hit = self._first_root(lambda h: motion(h)[0] - self.gap, left if turn is None else turn, blind)
        h = turn if hit is None else hit
        if h is None:
            return False
        self.t += h
        self.y, self.v = motion(h)
        if hit is None:
            self.v = a.number(0)
        else:
            self.y = self.gap
            self._hit()
        return True

    def _hit(self) -> None:
        self.impacts.append(Impact(self.t, self.v))
        slow = self.v < LEAST_BOUNCE_M_S and self._push(self.t) > self.held
        self.v = self.arithmetic.number(0) if slow or self.k == 0 else -self.k * self.v

    def _flight(
        self, y: Number, v: Number, theta: Number, sign: int
    ) -> Callable[[Number], tuple[Number, Number]]:
        a = self.arithmetic
        offset = -sign * self.held
        steady = self.G * a.exp(self.i * theta)
        free, rate = y - offset - steady.imag, v - (self.i * self.Omega * steady).imag
        first = (rate - self.l2 * free) / (self.l1 - self.l2)
        second = free - first

        def motion(h: Number) -> tuple[Number, Number]:
            e1, e2 = first * a.exp(self.l1 * h), second * a.exp(self.l2 * h)
            forced = steady * a.exp(self.i * self.Omega * h)
            position = (e1 + e2).real + forced.imag + offset
            return position, (self.l1 * e1 + self.l2 * e2).real + (self.i * self.Omega * forced).imag

        return motion

    def _first_root(self, guard: Guard, end: Number, blind: int = FINEST) -> Number | None:
        """First h in (0, end] where the guard rises through zero. It may start at zero."""
        a = self.arithmetic
        step = self.step
        grid = [step * a.number(2.0 ** (-k / 2)) for k in range(2 * blind, 0, -1)]
        before = last = (a.number(0), a.number(0))
        while last[0] < end:
            grid = [h for h in grid if h < end] or [end]
            for here in zip(grid, a.values(guard, grid), strict=True):
                if here[1] > 0:
                    return self._bisect(guard, last[0], here[0])
                if (
                    before[0] > 0
                    and before[1] < last[1] > here[1]
                    and last[1] > before[1] - 2 * last[1] + here[1]
                ):
                    top = self._top(guard, before[0], here[0])
                    if top is not None:
                        return self._bisect(guard, before[0], top)
                before, last = last, here
            grid = [last[0] + step * i for i in range(1, 65)]
            if grid[-1] >= end > last[0]:
                grid = [h for h in grid if h < end] + [end] if grid[0] < end else [end]
        return None

    def _top(self, guard: Guard, low: Number, high: Number) -> Number | None:
        """A place around a local maximum where the guard is positive, if any: golden-section search."""
        for _ in range(self.arithmetic.bisections):
            left, right = low + (high - low) * 0.382, low + (high - low) * 0.618
            g_left, g_right = guard(left), guard(right)
            if g_left > 0 or g_right > 0:
                return left if g_left > 0 else right
            low, high = (low, right) if g_left > g_right else (left, high)
        return None

    def _bisect(self, guard: Guard, low: Number, high: Number) -> Number:
        if low == 0:  # the guard may start at zero and dip first: find a place below zero
            low = high
            while guard(low) > 0:
                low = low / 2
                if low < high * self.arithmetic.number(2.0**-60):
                    return low
        for _ in range(self.arithmetic.bisections):
            middle = (low + high) / 2
            low, high = (low, middle) if guard(middle) > 0 else (middle, high)
        return high
