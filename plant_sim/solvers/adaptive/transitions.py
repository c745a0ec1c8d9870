"""From phase to phase: what an event does to the state, and which phase follows.

FLIGHT ── touch ──▶ impact at a rigid stop ──▶ FLIGHT, or REST_ON_STOP once the rebound is spent
       ── touch ──▶ CONTACT with a soft stop ── leave ──▶ FLIGHT
FLIGHT, CONTACT ── halt ──▶ STICK, or sliding the other way
STICK, REST_ON_STOP ── release ──▶ FLIGHT or CONTACT
"""

import math

from plant_sim.kernels import by_part, law, subroutine
from plant_sim.parts.drive import Drive, IdealDrive, MotorDrive
from plant_sim.parts.friction import static_limit_n
from plant_sim.parts.housing import Housing, Level, Moving, Tilted, housing_m_s2, housing_m_s3
from plant_sim.parts.linkage import crank_torque_n_m
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import (
    HuntCrossley,
    KelvinVoigt,
    NoStop,
    RigidStop,
    Stop,
    contact_rate_rad_s,
    damping_s_m,
    elastic_energy_j,
    elastic_force_n,
    is_rigid,
    is_soft,
    restitution,
    stop_force_n,
)
from plant_sim.parts.walking import Walking
from plant_sim.parts.wearer import Ankle, NoWearer, Wearer, contact_mass_kg
from plant_sim.parts.winding import DqWinding, Winding
from plant_sim.sensors.sensing import Probe, sense_jump
from plant_sim.solvers.adaptive.currents import voltage_excess
from plant_sim.solvers.adaptive.events import (
    CLEAR,
    CRANK_BREAK,
    CRANK_HALT,
    HALT,
    LEAVE,
    LIMIT,
    NEAR_RAD,
    PRESS,
    RELEASE,
    TOUCH,
    TURN,
    UNLIMIT,
)
from plant_sim.solvers.adaptive.motion import (
    CONTACT,
    FLIGHT,
    REST,
    STICK,
    closing_m_s,
    crank_limit_n_m,
    crank_net_n_m,
    current_place,
    held_force_n,
    held_limit_n,
    work_place,
)
from plant_sim.solvers.adaptive.state_layout import (
    APPROACH,
    CRANK_ANGLE,
    CRANK_DIRECTION,
    CRANK_STUCK,
    DAMPING,
    DIRECTION,
    IMPACT_ANGLE,
    IMPACT_TIME,
    IMPACTS,
    IMPULSE,
    IMPULSE_BEFORE,
    IN_CONTACT,
    IN_IMPACT,
    LEAVE_SPEED,
    LET_GO,
    NO_IMPACT,
    PEAK,
    PEAK_FORCE,
    PHASE,
    REBOUND,
    REST_SPEED,
    TOUCH_ANGLE,
    TOUCH_SPEED,
    TOUCH_TIME,
    TURNS,
    VOLTAGE_LIMITED,
    ZERO_CRANK,
    ZERO_DEPTH,
    ZERO_VELOCITY,
    ZERO_VOLTAGE,
    Memory,
)

TURN_LOW = 2.4492935982947064e-16
"""By what 2π exceeds its nearest double: with it, many turns taken off leave no drift."""


@by_part
def crank_angle(drive: Drive, memory: Memory) -> float:
    """Crank angle, rad, at the last step's end."""
    raise NotImplementedError


@law(crank_angle, IdealDrive)
def _(drive: IdealDrive, memory: Memory) -> float:
    angle_rad: float = memory.held[CRANK_ANGLE]
    return angle_rad


@law(crank_angle, MotorDrive)
def _(drive: MotorDrive, memory: Memory) -> float:
    angle_rad: float = memory.y[2]
    return angle_rad


@by_part
def turn_crank(drive: Drive, memory: Memory, h_s: float) -> None:
    """Carry the crank's angle over a step, within [0, 2π)."""
    raise NotImplementedError


@law(turn_crank, IdealDrive)
def _(drive: IdealDrive, memory: Memory, h_s: float) -> None:
    angle_rad, turns = within_a_turn(memory.held[CRANK_ANGLE] + drive.omega_rad_s * h_s)
    memory.held[CRANK_ANGLE] = angle_rad
    memory.mode[TURNS] += turns


@law(turn_crank, MotorDrive)
def _(drive: MotorDrive, memory: Memory, h_s: float) -> None:
    angle_rad, turns = within_a_turn(memory.y[2])
    memory.y[2] = angle_rad
    memory.mode[TURNS] += turns


@subroutine
def within_a_turn(angle_rad: float) -> tuple[float, int]:
    """The angle in [0, 2π) and the whole turns taken off."""
    turns = math.floor(angle_rad / TURN)
    if turns == 0:
        return angle_rad, 0
    rest = (angle_rad - turns * TURN) - turns * TURN_LOW
    if rest < 0.0:  # by rounding
        return rest + TURN, turns - 1
    return rest, turns


@by_part
def crank_speed(drive: Drive, memory: Memory) -> float:
    """Crank speed, rad/s, at the last step's end."""
    raise NotImplementedError


@law(crank_speed, IdealDrive)
def _(drive: IdealDrive, memory: Memory) -> float:
    return drive.omega_rad_s


@law(crank_speed, MotorDrive)
def _(drive: MotorDrive, memory: Memory) -> float:
    speed_rad_s: float = memory.y[3]
    return speed_rad_s


@subroutine
def settle(parts: Parts, memory: Memory, torque_n_m: float, time_s: float) -> None:
    """Find the first phase of a module that has just been set up."""
    y, mode, stop = memory.y, memory.mode, parts.stop
    settle_crank(parts.drive, parts, memory, torque_n_m)
    mode[PHASE] = FLIGHT
    mode[DIRECTION] = 1 if y[1] > 0.0 else -1
    if is_soft(stop) and y[0] > 0.0:
        lets_go = LET_GO
        if mode[IN_IMPACT] == NO_IMPACT:
            lets_go = NO_IMPACT
            _open_contact(parts, memory, time_s, 0)
        mode[PHASE] = CONTACT
        mode[IN_IMPACT] = IN_CONTACT
        closing = closing_m_s(parts.wearer, parts.drive, y)
        if stop_force_n(stop, elastic_force_n(stop, y[0]), closing, memory.contact[DAMPING]) < 0.0:
            memory.contact[LEAVE_SPEED] = closing
            mode[PHASE] = FLIGHT
            mode[IN_IMPACT] = lets_go
    elif is_soft(stop) and mode[IN_IMPACT] != NO_IMPACT:  # taken out of it from outside
        memory.contact[LEAVE_SPEED] = closing_m_s(parts.wearer, parts.drive, y)
        _record_contact(parts, memory)
    if y[1] == 0.0:
        _from_rest(parts, memory, time_s)
    elif y[0] == 0.0 and y[1] < 0.0:
        mode[ZERO_DEPTH] = 1


@by_part
def settle_crank(drive: Drive, parts: Parts, memory: Memory, torque_n_m: float) -> None:
    """Whether a resting crank stays at rest under this torque, and else which way it turns."""
    return


@law(settle_crank, MotorDrive)
def _(drive: MotorDrive, parts: Parts, memory: Memory, torque_n_m: float) -> None:
    y, mode = memory.y, memory.mode
    mode[CRANK_STUCK] = 0
    mode[ZERO_CRANK] = 0
    if drive.dry_n_m == 0.0:
        mode[CRANK_DIRECTION] = 0
        return
    if y[3] != 0.0:
        mode[CRANK_DIRECTION] = 1 if y[3] > 0.0 else -1
        return
    net = crank_net_n_m(parts, torque_n_m, y[2], y)
    mode[CRANK_DIRECTION] = 1 if net > 0.0 else -1
    mode[ZERO_CRANK] = 1
    if abs(net) <= crank_limit_n_m(parts, drive.dry_n_m, torque_n_m, y[2], y):
        mode[CRANK_DIRECTION] = 0
        mode[CRANK_STUCK] = 1


@subroutine
def apply(parts: Parts, probe: Probe, memory: Memory, torque_n_m: float, event: int, time_s: float) -> None:
    """What an event does."""
    if event == TOUCH:
        _touch(parts, probe, memory, time_s)
    elif event == PRESS:
        _press(parts, memory, time_s)
    elif event == LEAVE:
        _leave(parts, memory)
    elif event == CLEAR:
        memory.y[0] = 0.0
        memory.mode[ZERO_DEPTH] = 1
        if memory.mode[IN_IMPACT] == LET_GO:
            _record_contact(parts, memory)
    elif event == HALT:
        memory.y[1] = 0.0
        _from_rest(parts, memory, time_s)
    elif event == RELEASE:
        _release(parts, memory, time_s)
    elif event == CRANK_HALT:
        _halt_crank(parts.drive, parts, memory, torque_n_m)
    elif event == CRANK_BREAK:
        _break_crank(parts.drive, parts, memory, torque_n_m)
    elif event in (LIMIT, UNLIMIT):
        _limit_voltage(parts.winding, memory, event)


@by_part
def settle_voltage(winding: Winding, drive: Drive, parts: Parts, memory: Memory, torque_n_m: float) -> None:
    """Whether the bus limits the current loop from now on, the torque asked for being this."""
    return


@law(settle_voltage, DqWinding)
def _(winding: DqWinding, drive: MotorDrive, parts: Parts, memory: Memory, torque_n_m: float) -> None:
    place, omega = current_place(parts), crank_speed(drive, memory)
    excess = voltage_excess(winding, drive, torque_n_m, omega, memory.y, place)
    memory.mode[VOLTAGE_LIMITED] = 1 if excess > 0.0 else 0
    memory.mode[ZERO_VOLTAGE] = 0


@by_part
def _limit_voltage(winding: Winding, memory: Memory, event: int) -> None:
    return


@law(_limit_voltage, DqWinding)
def _(winding: DqWinding, memory: Memory, event: int) -> None:
    memory.mode[VOLTAGE_LIMITED] = 1 if event == LIMIT else 0
    memory.mode[ZERO_VOLTAGE] = 1


@by_part
def is_voltage_limited(winding: Winding, memory: Memory) -> bool:
    """Whether the bus limits a current loop now."""
    return False


@law(is_voltage_limited, DqWinding)
def _(winding: DqWinding, memory: Memory) -> bool:
    limited: bool = memory.mode[VOLTAGE_LIMITED] == 1
    return limited


@by_part
def voltage_zeros(winding: Winding, memory: Memory) -> int:
    """How many derivatives of the voltage's excess are zero at the step's start; forgets them."""
    return 0


@law(voltage_zeros, DqWinding)
def _(winding: DqWinding, memory: Memory) -> int:
    zeros: int = memory.mode[ZERO_VOLTAGE]
    memory.mode[ZERO_VOLTAGE] = 0
    return zeros


@by_part
def _halt_crank(drive: Drive, parts: Parts, memory: Memory, torque_n_m: float) -> None:
    return


@law(_halt_crank, MotorDrive)
def _(drive: MotorDrive, parts: Parts, memory: Memory, torque_n_m: float) -> None:
    memory.y[3] = 0.0
    settle_crank(drive, parts, memory, torque_n_m)


@by_part
def _break_crank(drive: Drive, parts: Parts, memory: Memory, torque_n_m: float) -> None:
    return


@law(_break_crank, MotorDrive)
def _(drive: MotorDrive, parts: Parts, memory: Memory, torque_n_m: float) -> None:
    net = crank_net_n_m(parts, torque_n_m, memory.y[2], memory.y)
    memory.mode[CRANK_STUCK] = 0
    memory.mode[CRANK_DIRECTION] = 1 if net > 0.0 else -1
    memory.mode[ZERO_CRANK] = 2


@subroutine
def _touch(parts: Parts, probe: Probe, memory: Memory, time_s: float) -> None:
    """Reach the stop from outside, at depth 0."""
    y, mode = memory.y, memory.mode
    y[0] = 0.0
    v = closing_m_s(parts.wearer, parts.drive, y)
    if v < 0.0:  # a graze that rounding made an event
        mode[ZERO_DEPTH] = 1
    elif v == 0.0 and y[1] != 0.0:  # striker and plate side by side
        mode[ZERO_DEPTH] = 2
    elif v == 0.0:
        _from_rest(parts, memory, time_s)
    elif is_soft(parts.stop):
        _open_contact(parts, memory, time_s, _leaving_zeros(parts.stop))
    else:
        _strike(parts, probe, memory, time_s)
        if y[1] > -memory.held[REST_SPEED]:
            loss = 0.5 * parts.striker.mass_kg * y[1] * y[1]
            y[work_place(parts) + 2] += loss
            y[1] = 0.0
            _from_rest(parts, memory, time_s)


@subroutine
def _strike(parts: Parts, probe: Probe, memory: Memory, time_s: float) -> None:
    """Newton's law: v⁺ = −k v⁻."""
    mass, k = parts.striker.mass_kg, restitution(parts.stop)
    v = memory.y[1]
    memory.y[1] = -k * v
    memory.y[work_place(parts) + 2] += 0.5 * mass * v * v * (1.0 - k * k)
    memory.mode[DIRECTION] = -1
    memory.mode[ZERO_DEPTH] = 1
    _record(memory, time_s, v, -k * v, mass * (1.0 + k) * v, math.nan, crank_angle(parts.drive, memory))
    sense_jump(probe, (1.0 + k) * v)


@by_part
def _leaving_zeros(stop: Stop) -> int:
    """How many derivatives of what ends a contact are zero where it begins, at depth 0 with some speed."""
    raise NotImplementedError


@law(_leaving_zeros, NoStop, RigidStop, HuntCrossley)
def _(stop: NoStop | RigidStop | HuntCrossley) -> int:
    return 1


@law(_leaving_zeros, KelvinVoigt)
def _(stop: KelvinVoigt) -> int:
    return 0 if stop.damping_n_s_m > 0.0 else 1


@subroutine
def _open_contact(parts: Parts, memory: Memory, time_s: float, zeros: int) -> None:
    y, mode, contact = memory.y, memory.mode, memory.contact
    mode[PHASE] = CONTACT
    mode[IN_IMPACT] = IN_CONTACT
    mode[ZERO_DEPTH] = zeros
    speed = max(closing_m_s(parts.wearer, parts.drive, y), 0.0)
    contact[TOUCH_TIME] = time_s
    contact[TOUCH_SPEED] = speed
    contact[TOUCH_ANGLE] = crank_angle(parts.drive, memory)
    contact[DAMPING] = damping_s_m(parts.stop, speed)
    # In a stiff stop an error of position weighs as much as one of velocity does within the contact.
    mass = contact_mass_kg(parts.wearer, parts.striker.mass_kg)
    rate = contact_rate_rad_s(parts.stop, mass, speed)
    memory.contact_scale[0] = min(memory.scale[0], memory.contact_scale[1] / rate)
    contact[PEAK] = 0.0
    contact[IMPULSE_BEFORE] = y[work_place(parts) + 3]


@subroutine
def _press(parts: Parts, memory: Memory, time_s: float) -> None:
    """Meet a stop that let go early and has not yet been cleared: it holds its spring's energy again.

    The contact that it had let go of goes on.
    """
    memory.y[work_place(parts) + 2] -= elastic_energy_j(parts.stop, memory.y[0])
    if memory.mode[IN_IMPACT] == NO_IMPACT:
        _open_contact(parts, memory, time_s, 1)
        return
    memory.mode[PHASE] = CONTACT
    memory.mode[IN_IMPACT] = IN_CONTACT
    memory.mode[ZERO_DEPTH] = 1


@subroutine
def _leave(parts: Parts, memory: Memory) -> None:
    """The stop no longer presses; what one that lets go early still holds is lost in its relaxing.

    The impact ends where the striker clears the stop's surface: until then it may be pressed again.
    """
    y, mode = memory.y, memory.mode
    lets_go_early = _leaving_zeros(parts.stop) == 0
    if not lets_go_early:
        y[0] = 0.0
    y[work_place(parts) + 2] += elastic_energy_j(parts.stop, y[0])
    mode[PHASE] = FLIGHT
    mode[IN_IMPACT] = LET_GO
    closing = closing_m_s(parts.wearer, parts.drive, y)
    mode[ZERO_DEPTH] = 1 if closing < 0.0 else 2
    memory.contact[LEAVE_SPEED] = closing
    if not lets_go_early:
        _record_contact(parts, memory)


@subroutine
def _record_contact(parts: Parts, memory: Memory) -> None:
    """The impact that a contact was, once it is over."""
    contact = memory.contact
    memory.mode[IN_IMPACT] = NO_IMPACT
    _record(
        memory,
        contact[TOUCH_TIME],
        contact[TOUCH_SPEED],
        contact[LEAVE_SPEED],
        memory.y[work_place(parts) + 3] - contact[IMPULSE_BEFORE],
        contact[PEAK],
        contact[TOUCH_ANGLE],
    )


@subroutine
def _from_rest(parts: Parts, memory: Memory, time_s: float) -> None:
    """What a striker at v = 0 does next: stick, rest on a rigid stop, or move the way it is pulled."""
    y, mode = memory.y, memory.mode
    net = _set_off_force_n(parts.wearer, parts, memory, time_s)
    dry = static_limit_n(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2)
    rounding = held_limit_n(parts, y, time_s) - dry
    growth, near = _pull_growth(parts.housing, parts, memory, time_s)
    near = max(near, rounding) if growth != 0.0 else rounding
    is_on_stop = is_rigid(parts.stop) and y[0] == 0.0
    breaks_forward = not is_on_stop and (net > dry + near or (net > dry - near and growth > 0.0))
    breaks_back = net < -dry - near or (net < near - dry and growth < 0.0)
    if not breaks_forward and not breaks_back and (is_on_stop or dry > 0.0):
        mode[PHASE] = REST if is_on_stop else STICK
        return
    forward = breaks_forward
    if breaks_forward == breaks_back:  # free, and without a pull
        forward = growth > 0.0 or (growth == 0.0 and net >= 0.0)
    _set_off(parts, memory, time_s, forward, 1 if abs(net) > dry + near else 2)


@by_part
def _set_off_force_n(wearer: Wearer, parts: Parts, memory: Memory, time_s: float) -> float:
    """Force, N, that says which way a striker at rest sets off."""
    raise NotImplementedError


@law(_set_off_force_n, NoWearer)
def _(wearer: NoWearer, parts: Parts, memory: Memory, time_s: float) -> float:
    return held_force_n(parts, crank_angle(parts.drive, memory), memory.y, time_s)


@law(_set_off_force_n, Ankle)
def _(wearer: Ankle, parts: Parts, memory: Memory, time_s: float) -> float:
    force_n = held_force_n(parts, crank_angle(parts.drive, memory), memory.y, time_s)
    if memory.y[0] == 0.0:  # at a plate at rest, which the housing moves along as it does the striker
        force_n += parts.striker.mass_kg * housing_m_s2(parts.housing, time_s)
    return force_n


@by_part
def _pull_growth(housing: Housing, parts: Parts, memory: Memory, time_s: float) -> tuple[float, float]:
    """Growth of the pull on a resting striker with time, N/s, and how much it changes near by, N.

    So near the limit the growth decides; it is twice NEAR_RAD, so that no release is passed over. Where the
    piston turns round there is no growth to speak of: nothing breaks away there on its own.
    """
    raise NotImplementedError


@law(_pull_growth, Level, Tilted)
def _(housing: Level | Tilted, parts: Parts, memory: Memory, time_s: float) -> tuple[float, float]:
    angle = crank_angle(parts.drive, memory)
    if abs(math.cos(angle)) < 1e-4:
        return 0.0, 0.0
    per_rad = crank_torque_n_m(parts.linkage, parts.striker.spring_n_m, parts.drive.amplitude_m, angle)
    return per_rad * crank_speed(parts.drive, memory), abs(per_rad) * 2.0 * NEAR_RAD


@law(_pull_growth, Moving, Walking)
def _(housing: Moving | Walking, parts: Parts, memory: Memory, time_s: float) -> tuple[float, float]:
    angle, striker = crank_angle(parts.drive, memory), parts.striker
    per_rad = crank_torque_n_m(parts.linkage, striker.spring_n_m, parts.drive.amplitude_m, angle)
    shaken = striker.mass_kg * housing_m_s3(housing, time_s)
    natural = math.sqrt(striker.spring_n_m / striker.mass_kg)
    growth = per_rad * crank_speed(parts.drive, memory) - shaken
    return growth, (abs(per_rad) + abs(shaken) / natural) * 2.0 * NEAR_RAD


@subroutine
def _release(parts: Parts, memory: Memory, time_s: float) -> None:
    """The spring's pull has just passed what held the striker: it sets off with no acceleration yet."""
    net = held_force_n(parts, crank_angle(parts.drive, memory), memory.y, time_s)
    forward = net > 0.0 and memory.mode[PHASE] == STICK
    _set_off(parts, memory, time_s, forward, 2)


@subroutine
def _set_off(parts: Parts, memory: Memory, time_s: float, forward: bool, zeros: int) -> None:
    """Slide on from v = 0, of whose derivatives, v included, `zeros` are zero."""
    y, mode = memory.y, memory.mode
    mode[DIRECTION] = 1 if forward else -1
    mode[ZERO_VELOCITY] = zeros
    if mode[IN_IMPACT] == IN_CONTACT:
        mode[PHASE] = CONTACT
        return
    mode[PHASE] = FLIGHT
    if y[0] == 0.0 and not forward:
        mode[ZERO_DEPTH] = zeros + 1
    elif is_soft(parts.stop) and y[0] == 0.0:
        _open_contact(parts, memory, time_s, zeros + _leaving_zeros(parts.stop))


@subroutine
def _record(
    memory: Memory,
    time_s: float,
    approach_m_s: float,
    rebound_m_s: float,
    impulse_n_s: float,
    peak_force_n: float,
    angle_rad: float,
) -> None:
    row = memory.impacts[memory.mode[IMPACTS]]
    row[IMPACT_TIME] = time_s
    row[APPROACH] = approach_m_s
    row[REBOUND] = rebound_m_s
    row[IMPULSE] = impulse_n_s
    row[PEAK_FORCE] = peak_force_n
    row[IMPACT_ANGLE] = angle_rad
    memory.mode[IMPACTS] += 1
