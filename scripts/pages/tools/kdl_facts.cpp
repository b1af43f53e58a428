// SPDX-License-Identifier: BSD-2-Clause
// What kdl_parser and KDL make of a URDF: joints, mass and segments, each on a line; then for every
// line q, v, a on standard input a line with the poses of the segments and the joint torques.
#include <iomanip>
#include <iostream>

#include <kdl/treefksolverpos_recursive.hpp>
#include <kdl/treeidsolver_recursive_newton_euler.hpp>
#include <kdl_parser/kdl_parser.hpp>

int main(int, char** argv) {
  KDL::Tree tree;
  if (!kdl_parser::treeFromFile(argv[1], tree)) return 1;
  const unsigned n = tree.getNrOfJoints();
  std::vector<std::string> joints(n);
  double mass = 0;
  for (const auto& [name, element] : tree.getSegments()) {
    const auto& segment = element.segment;
    mass += segment.getInertia().getMass();
    if (segment.getJoint().getType() != KDL::Joint::None)
      joints[element.q_nr] = segment.getJoint().getName();
  }
  for (const auto& joint : joints) std::cout << joint << ' ';
  std::cout << '\n' << std::setprecision(17) << mass << '\n';
  for (const auto& entry : tree.getSegments()) std::cout << entry.first << ' ';
  std::cout << std::endl;

  KDL::TreeFkSolverPos_recursive kinematics(tree);
  KDL::TreeIdSolver_RNE dynamics(tree, KDL::Vector(0, 0, -9.81));
  KDL::JntArray q(n), v(n), a(n), tau(n);
  while (true) {
    for (auto* x : {&q, &v, &a})
      for (unsigned i = 0; i < n; i++) std::cin >> (*x)(i);
    if (!std::cin) return 0;
    for (const auto& entry : tree.getSegments()) {
      KDL::Frame pose;
      kinematics.JntToCart(q, pose, entry.first);
      for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++) std::cout << pose(i, j) << ' ';
    }
    dynamics.CartToJnt(q, v, a, KDL::WrenchMap(), tau);
    for (unsigned i = 0; i < n; i++) std::cout << tau(i) << ' ';
    std::cout << std::endl;
  }
}
