# SPDX-License-Identifier: BSD-2-Clause
"""From `Parameters` to the files that describe the robot.

The robot is a tree of three legs; the cuts close it. The star is cut into its three arcs: leg k
ends in `star_k`, which carries a third of the star's mass and inertia about the star's mass centre,
so that the three make up body 7 when the closures hold and no moving link is massless.
"""
