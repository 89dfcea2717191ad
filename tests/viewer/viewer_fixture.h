// A viewer without a window, for tests: events in, pictures out.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "tests/player/session_fixture.h"
#include "tests/renderer/shared_context.h"
#include "tests/support/temp_folder.h"
#include "viewer/viewer.h"
#include "viewer/window/byte_target.h"

namespace splatvol::test {

class ViewerFixture : public FolderTest {
 protected:
  void SetUp() override { ASSERT_TRUE(shared_context()); }

  /// Opens a viewer anew, in a window of the last size.
  void open(const ViewerOptions& options) {
    viewer.reset();
    auto made = Viewer::create(options);
    ASSERT_TRUE(made) << made.error().message;
    viewer = std::move(*made);
    frame({window_});
  }
  void resize(int width, int height) {
    window_ = {width, height, width, height, 1};
    ASSERT_TRUE(target.resize(width, height));
    if (viewer) frame({window_});
  }

  void frame(std::vector<Event> events) { frame(std::move(events), frame_seconds); }
  void frame(std::vector<Event> events, double seconds) {
    target.use();
    const Status status = viewer->frame({seconds, std::move(events)});
    ASSERT_TRUE(status) << status.error().message;
  }
  void settle() {
    int frames = 0;
    do {
      frame({});
      ASSERT_LT(++frames, 100000);
    } while (!viewer->is_settled());
  }
  void press(int code) {
    frame({KeyChanged{code, true}});
    frame({KeyChanged{code, false}});
  }
  void press_with_control(int code) {
    frame({KeyChanged{key::left_control, true}, KeyChanged{code, true}});
    frame({KeyChanged{code, false}, KeyChanged{key::left_control, false}});
  }
  /// Drags through points of the window. One point is a click.
  void drag(const std::vector<dvec2>& points) {
    frame({PointerMoved{points[0].x, points[0].y}});
    frame({});  // the interface knows a frame later which control is under the pointer
    frame({ButtonChanged{0, true}});
    for (const dvec2& at : std::span(points).subspan(1)) frame({PointerMoved{at.x, at.y}});
    frame({ButtonChanged{0, false}});
  }
  void click(double x, double y) { drag({{x, y}}); }

  Image screen() {
    target.use();
    return read_framebuffer(window_.width, window_.height).value();
  }
  const Scene& scene() const { return viewer->session()->scene; }

  double frame_seconds = long_time;
  ByteTarget target;
  std::unique_ptr<Viewer> viewer;

 private:
  WindowResized window_{};
};

}  // namespace splatvol::test
