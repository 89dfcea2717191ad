// The ways to draw splats.
#pragma once

#include <memory>
#include <vector>

#include "renderer/device/device.h"
#include "renderer/rasterizer.h"

namespace splatvol::test {

struct Way {
  const char* name;
  Device device;
};
inline constexpr Way by_splats{"splats", Device::cpu}, by_gl{"gl", Device::gl};

inline std::vector<Way> all_ways() {
  std::vector<Way> ways{by_splats};
  if (parse_device("gl")) ways.push_back(by_gl);  // else the build has no OpenGL
  return ways;
}

inline std::unique_ptr<Rasterizer> make_rasterizer_for(const Way& way, KernelKind kernel) {
  return make_rasterizer(way.device, {.kernel = kernel}).value();
}

}  // namespace splatvol::test
