"""Three ways to obtain one pulse a stride, each simulated on walks: one turn a stride, subharmonics, gating.

- *turn*: n = 1. The crank turns once a stride; the spring is chosen so that r = 1.1 at that cadence.
- *subharmonic*: the crank turns n times a stride with one impact in n turns. These orbits are first searched
  for on a standing leg with a rigid stop, from many initial states (`orbits`).
- *gated*: the crank rests except for one impact a stride (`gate`).

The first two ways assume conditions that no firmware has: an ideal crank at the true phase of the walk, a
module designed for this cadence, and RUN_IN strides to bring the impact into the window. The third way has a
motor with its limits, the firmware's phase estimate from noisy sensors, and modules sampled as in the
campaigns. The gate's numbers were chosen with other walks (seeds 1 to 6) than the judged walks, which have
DEFAULT_SEED.

A stride is counted as right if it has exactly one impact, within the push-off window. Walks vary by 2 % from
stride to stride.
"""
