"""Couples plant.fmu and firmware.fmu; the operator's frames come from run/can.log."""

import struct

from fmpy import extract, fmi2, read_model_description

PERIOD_S, TICKS = 1e-3, 33_000
OPERATOR, HEARTBEAT = 0x048, 0x068
MODES = ("INIT", "READY", "SOFT_START", "RUN", "STOPPING", "FAULT", "E_STOP", "PROOF")


class Node:
    """A unit with frames in and out: rows of identifier, length, and the bytes as two integers."""

    def __init__(self, file):
        folder, about = extract(file), read_model_description(file)
        self.places = {one.name: one.valueReference for one in about.modelVariables}
        name = about.coSimulation.modelIdentifier
        self.unit = fmi2.FMU2Slave(guid=about.guid, unzipDirectory=folder, modelIdentifier=name)
        self.unit.instantiate()
        self.unit.setupExperiment(startTime=0.0)
        self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()

    def step(self, tick, frames):
        """Make a step with the frames that have arrived; return those that it sends."""
        values = [len(frames), *(number for frame in frames for number in frame)]
        first, sent = self.places["received.count"], self.places["sent.count"]
        self.unit.setInteger(range(first, first + len(values)), values)
        self.unit.doStep(tick * PERIOD_S, PERIOD_S)
        (count,) = self.unit.getInteger([sent])
        numbers = self.unit.getInteger(range(sent + 1, sent + 1 + 4 * count))
        return [tuple(numbers[4 * row : 4 * row + 4]) for row in range(count)]


commands = {tick: [] for tick in range(TICKS)}
with open("run/can.log") as recorded:
    for line in recorded:
        stamp, _, content = line.split()
        can_id, data = content.split("#")
        if int(can_id, 16) == OPERATOR:
            numbers = struct.unpack("<ii", bytes.fromhex(data).ljust(8, b"\0"))
            commands[round(float(stamp[1:-1]) / PERIOD_S)].append((OPERATOR, len(data) // 2, *numbers))

plant, firmware = Node("plant.fmu"), Node("firmware.fmu")
last_impact = [plant.places[f"impact.{name}"] for name in ("count", "t_s", "v_m_s")]
to_plant, impacts, mode = [], 0, None
with open("coupled.log", "w") as log:
    for tick in range(TICKS):
        to_firmware = plant.step(tick, to_plant) + commands[tick]
        from_firmware = firmware.step(tick, to_firmware)
        to_plant = commands[tick] + from_firmware
        for t_s, frames in ((tick * PERIOD_S, to_firmware), ((tick + 0.5) * PERIOD_S, from_firmware)):
            for can_id, length, low, high in frames:
                data = struct.pack("<ii", low, high)[:length].hex().upper()
                log.write(f"({t_s:.6f}) can0 {can_id:03X}#{data}\n")
                if can_id == HEARTBEAT and low & 15 != mode:
                    mode = low & 15
                    print("mode", tick, MODES[mode])
        count, t_s, v_m_s = plant.unit.getReal(last_impact)
        if count > impacts:
            print("impact", t_s, v_m_s)
        impacts = count
