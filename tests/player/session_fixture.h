// Sessions with threads, whose pictures the processor draws: no window, no OpenGL.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "builder/series/series_build.h"
#include "player/session.h"
#include "player/thread_host.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/support/results.h"
#include "tests/support/stalled_source.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test_volume.h"

namespace splatvol::test {

constexpr double long_time = 1;  // seconds: longer than any change takes

inline ThreadHost host;  // of sessions

/// Writes a file with the attributes a0 = x and a1, the distance from the middle.
inline void write_two_attributes(const std::string& path) {
  const auto points = random_points(3000, 1u);
  std::vector<double> heat, wind;
  for (const dvec3& p : points) heat.push_back(p.x), wind.push_back(glm::length(p - 0.5));
  require(write_test_volume(make_test_volume(points, {heat, wind}), path));
}

/// A step of a time series: waves, and the number of the step.
inline SeriesStep step_at(int step, std::uint32_t cells = 12) {
  return mesh_step(0.5 * step, lattice(cells), [step](dvec3 p) { return std::sin(5 * p.x + step) + step; });
}

/// Writes a file of three steps.
inline void write_series(const std::string& path, const BuildOptions& options = {}) {
  require(build_series({step_at(0), step_at(1), step_at(2)}, path, options, [](const char*, double) {}));
}

class SessionFixture : public FolderTest {
 protected:
  explicit SessionFixture(int picture_width = 200, int picture_height = 150)
      : width(picture_width), height(picture_height) {}

  /// Opens a file with `settings`.
  [[nodiscard]] std::unique_ptr<Session> open(const std::string& file, SessionHost& with = host) const {
    return value_of(Session::open(file, "", settings, with));
  }

  /// The same of a file whose reads wait while `stalls`.
  [[nodiscard]] std::unique_ptr<Session> open_slow(const std::string& file) {
    const auto open = [this](const std::string& name) { return open_stalled(name, stalls, waiting); };
    return value_of(Session::open(value_of(Session::read({.file = file}, "", settings, open)), host));
  }

  void draw(Session& session, double seconds = long_time) const {
    ASSERT_EQ(message_of(session.draw(width, height, seconds)), "");
  }
  Image settled(Session& session) const {
    do draw(session);
    while (!session.is_settled());  // ends by the test's time limit
    return value_of(session.image());
  }

  int width, height;  // of pictures
  ViewSettings settings{.device = Device::cpu, .in_current_context = false};
  std::atomic<bool> stalls = false;
  std::atomic<int> waiting = 0;
};

}  // namespace splatvol::test
