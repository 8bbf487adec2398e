// Reads an SDF file with libsdformat: prints a line for each model with the pose that it resolves.
#include <iostream>
#include <sdf/sdf.hh>

int main(int, char** arguments) {
  sdf::Root root;
  for (const auto& error : root.Load(arguments[1])) {
    std::cerr << error.Message() << '\n';
    return 1;
  }
  const sdf::World* world = root.WorldByIndex(0);
  std::cout.precision(17);
  for (uint64_t nth = 0; nth < world->ModelCount(); ++nth) {
    const sdf::Model* model = world->ModelByIndex(nth);
    ignition::math::Pose3d pose;
    if (!model->SemanticPose().Resolve(pose).empty()) return 2;
    std::cout << model->Name() << '\t' << pose.Pos().X() << '\t' << pose.Pos().Y() << '\t' << pose.Pos().Z() << '\t'
              << pose.Rot().X() << '\t' << pose.Rot().Y() << '\t' << pose.Rot().Z() << '\t' << pose.Rot().W() << '\n';
  }
  return 0;
}
