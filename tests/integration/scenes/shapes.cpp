// Reads a .scene file with MoveIt's own shape reader: prints a line for each shape.
#include <geometric_shapes/shape_operations.h>

#include <fstream>
#include <iostream>
#include <sstream>

int main(int, char** arguments) {
  std::ifstream in(arguments[1]);
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line) && line.rfind("* ", 0) == 0) {
    const std::string object = line.substr(2);
    double pose[7];
    for (double& part : pose) in >> part;
    unsigned count = 0;
    in >> count;
    for (unsigned nth = 0; nth < count; ++nth) {
      shapes::Shape* shape = shapes::constructShapeFromText(in);
      double own[7], color[4];
      for (double& part : own) in >> part;
      for (double& part : color) in >> part;
      std::cout.precision(17);
      std::cout << object << '\t' << shapes::shapeStringName(shape);
      switch (shape->type) {
        case shapes::SPHERE: std::cout << '\t' << static_cast<shapes::Sphere*>(shape)->radius; break;
        case shapes::CYLINDER: {
          auto* cylinder = static_cast<shapes::Cylinder*>(shape);
          std::cout << '\t' << cylinder->radius << '\t' << cylinder->length;
          break;
        }
        case shapes::CONE: {
          auto* cone = static_cast<shapes::Cone*>(shape);
          std::cout << '\t' << cone->radius << '\t' << cone->length;
          break;
        }
        case shapes::BOX: {
          auto* box = static_cast<shapes::Box*>(shape);
          std::cout << '\t' << box->size[0] << '\t' << box->size[1] << '\t' << box->size[2];
          break;
        }
        case shapes::PLANE: {
          auto* plane = static_cast<shapes::Plane*>(shape);
          std::cout << '\t' << plane->a << '\t' << plane->b << '\t' << plane->c << '\t' << plane->d;
          break;
        }
        case shapes::MESH: {
          auto* mesh = static_cast<shapes::Mesh*>(shape);
          std::cout << '\t' << mesh->vertex_count << '\t' << mesh->triangle_count;
          break;
        }
        default: break;
      }
      std::cout << '\n';
    }
    unsigned subframes = 0;
    in >> subframes;
    for (unsigned nth = 0; nth < subframes; ++nth) {
      std::string name;
      in >> name;
      for (double& part : pose) in >> part;
    }
    std::getline(in, line);
  }
  return line == "." ? 0 : 1;
}
