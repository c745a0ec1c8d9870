"""Three ways to one pulse a stride, each walked: a crank that turns once a stride, subharmonics, gating.

- *turn*: n = 1. The crank turns once a stride, its spring chosen so that r = 1.1 at that cadence.
- *subharmonic*: the crank turns n times a stride and there is one impact in n turns. Where there are
  such orbits is looked for first, on a standing leg behind a rigid stop, from many starts (`orbits`).
- *gated*: the crank rests but for one impact a stride (`gate`).

The first two are given what no firmware has: an ideal crank at the true phase of the walk, a module made for
that very cadence, and the time of RUN_IN strides to bring the impact into the window. The third has a motor
with its limits, the firmware's own phase estimate from noisy sensors, and modules sampled as in the
campaigns. The gate's numbers were chosen on other walks (seeds 1 to 6) than those of DEFAULT_SEED, which are
judged.

A stride counts that has exactly one impact, in the push-off window. Walks vary by 2 % from stride to stride.
"""
