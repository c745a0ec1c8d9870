"""The controller of the vibro-impact module, written as firmware: received frames in, frames to send out.

`node.tick` is the whole firmware as one pure function. `core` holds its control blocks, `interface` the bus,
`builds` the compilers, `shell` the nodes that put each build on a bus.
"""
