#include "renderer/device/device.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "renderer/gl/context.h"
#include "tests/renderer/shared_context.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

TEST(Device, HasThreeNames) {
  EXPECT_EQ(parse_device("auto").value(), Device::automatic);
  EXPECT_EQ(parse_device("cpu").value(), Device::cpu);
  EXPECT_EQ(parse_device("gl").value(), Device::gl);
  EXPECT_THAT(parse_device("vulkan").error().message, HasSubstr("auto, cpu and gl"));
}

TEST(Device, SaysWhatDraws) {
  ASSERT_TRUE(shared_context());
  EXPECT_THAT(make_rasterizer(Device::cpu, {}).value()->description(), HasSubstr("processor"));
  const auto gl = make_rasterizer(Device::gl, {.in_current_context = true}).value();
  EXPECT_EQ(gl->description(), shared_context()->description());
}

TEST(Device, AutoTakesTheProcessorWhereOpenGlDrawsInSoftware) {
  ASSERT_TRUE(shared_context());
  const auto chosen = make_rasterizer(Device::automatic, {.in_current_context = true}).value();
  const bool in_software = is_software_renderer(shared_context()->description());
  EXPECT_EQ(std::holds_alternative<const Image*>(chosen->picture()), in_software);
  EXPECT_EQ(chosen->capabilities().any_thread, in_software);
}

TEST(Device, KnowsOpenGlInSoftware) {
  for (const char* name : {"llvmpipe (LLVM 15.0.6, 256 bits)", "softpipe", "SWR (LLVM 11.0.0, 256 bits)",
                           "Software Rasterizer", "Google SwiftShader", "Apple Software Renderer"})
    EXPECT_TRUE(is_software_renderer(name)) << name;
  for (const char* name : {"NVIDIA H200/PCIe/SSE2", "AMD Radeon RX 6800 (navi21, LLVM 15.0.6, DRM 3.49)",
                           "Mesa Intel(R) UHD Graphics 620 (KBL GT2)", "virgl"})
    EXPECT_FALSE(is_software_renderer(name)) << name;
}

}  // namespace
}  // namespace splatvol::test
