// What draws.
#pragma once

namespace splatvol {

enum class Device {
  automatic,  // OpenGL on a graphics card, else the processor
  cpu,        // tiles on the processor
  gl,         // OpenGL, in software too
};

}  // namespace splatvol
