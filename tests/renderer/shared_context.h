// The one OpenGL context of the test program.
#pragma once

#include <memory>

#include "renderer/gl/context.h"

namespace splatvol {

/// Returns the context, made and made current at the first call, in the main thread. Null if this machine has none;
/// then the test fails.
const HeadlessContext* shared_context();

}  // namespace splatvol
