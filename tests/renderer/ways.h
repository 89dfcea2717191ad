// The ways to draw splats of the kernel `moments`.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "renderer/device/device.h"
#include "renderer/rasterizer.h"

namespace splatvol::test {

struct Way {
  const char* name;
  Device device;
  Compositing compositing;
};
inline constexpr Way by_splats{"splats", Device::cpu, Compositing::splats},
    by_slabs{"slabs", Device::cpu, Compositing::slabs}, by_gl{"gl", Device::gl, Compositing::splats};

inline std::vector<Way> all_ways() {
  std::vector<Way> ways{by_splats, by_slabs};
  if (parse_device("gl")) ways.push_back(by_gl);  // else the build has no OpenGL
  return ways;
}

inline std::unique_ptr<Rasterizer> make_rasterizer_for(const Way& way, KernelKind kernel) {
  std::unique_ptr<Rasterizer> rasterizer = make_rasterizer(way.device, {.kernel = kernel}).value();
  if (way.compositing == Compositing::slabs) {
    EXPECT_TRUE(rasterizer->set_compositing(Compositing::slabs));
  }
  return rasterizer;
}

}  // namespace splatvol::test
