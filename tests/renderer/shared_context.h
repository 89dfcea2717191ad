// The one OpenGL context of the test program.
#pragma once

#include <memory>

#include "renderer/context.h"

namespace splatvol {

/// Made current at the first call, in the main thread; null where this machine gives none, which fails the test.
const HeadlessContext* shared_context();

}  // namespace splatvol
