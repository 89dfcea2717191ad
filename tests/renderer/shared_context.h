// The one OpenGL context of the test program.
#pragma once

#include <gtest/gtest.h>

#include "renderer/gl/context.h"

namespace splatvol::test {

/// Returns the context, made and made current at the first call, in the main thread. Null if this machine has none;
/// then the test fails.
inline const HeadlessContext* shared_context() {
  static const auto context = HeadlessContext::create();
  if (context) return context->get();
  ADD_FAILURE() << context.error().message;
  return nullptr;
}

}  // namespace splatvol::test
