#include "player/camera_motion.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/quaternion.hpp>

namespace splatvol {

Camera camera_at(const Camera& first, const CameraMotion& motion, int frame) {
  const bool is_loop = motion.degrees != 0 && std::fmod(motion.degrees, 360) == 0 && motion.factor == 1;
  const double part = frame / std::max<double>(motion.frames - (is_loop ? 0 : 1), 1);
  const dvec3 center = motion.center.value_or(first.focal_point);
  const glm::dquat turn = glm::angleAxis(glm::radians(part * motion.degrees), glm::normalize(first.up));
  Camera camera = first;
  camera.focal_point = center + turn * (first.focal_point - center);
  const dvec3 position = center + turn * (first.position - center);
  camera.position = camera.focal_point + (position - camera.focal_point) * std::pow(motion.factor, part);
  return camera;
}

}  // namespace splatvol
