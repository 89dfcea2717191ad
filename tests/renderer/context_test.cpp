#include "renderer/gl/context.h"

#include <epoxy/gl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "renderer/gl/gl_rasterizer.h"
#include "tests/renderer/shared_context.h"

namespace splatvol {

namespace {

using test::shared_context;
using ::testing::HasSubstr;

TEST(HeadlessContext, IsCurrentAndCore45) {
  ASSERT_TRUE(shared_context());
  GLint major = 0;
  GLint minor = 0;
  GLint profile = 0;
  glGetIntegerv(GL_MAJOR_VERSION, &major);
  glGetIntegerv(GL_MINOR_VERSION, &minor);
  glGetIntegerv(GL_CONTEXT_PROFILE_MASK, &profile);
  EXPECT_GE(10 * major + minor, 45);
  EXPECT_EQ(profile, GL_CONTEXT_CORE_PROFILE_BIT);
}

TEST(HeadlessContext, SaysWhatDraws) {
  ASSERT_TRUE(shared_context());
  EXPECT_THAT(shared_context()->description(), HasSubstr("OpenGL 4."));
  EXPECT_THAT(shared_context()->description(), HasSubstr(reinterpret_cast<const char*>(glGetString(GL_RENDERER))));
}

}  // namespace
}  // namespace splatvol
