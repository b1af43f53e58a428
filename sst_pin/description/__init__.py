# SPDX-License-Identifier: BSD-2-Clause
"""From `Parameters` to the files that describe the robot.

The robot is a tree of three legs, and two welds close its loops. The star is cut into its three
arcs: leg k ends in `star_k`, which carries a third of the star's mass and inertia about the star's
mass centre. With closed loops the three parts are body 7, and no moving link is massless.
"""
