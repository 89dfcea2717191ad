// What draws.
#pragma once

namespace splatvol {

enum class Device {
  automatic,  // the processor, so that all machines draw the same; GlRenderer: OpenGL on a graphics card
  cpu,        // tiles on the processor
  gl,         // OpenGL, in software too
};

}  // namespace splatvol
