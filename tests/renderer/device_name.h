// Names of devices in the names of tests.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "renderer/device/device.h"

namespace splatvol::test {

inline std::string device_name(const testing::TestParamInfo<Device>& device) {
  return device.param == Device::gl ? "gl" : "cpu";
}

}  // namespace splatvol::test
