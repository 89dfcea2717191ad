// A long use of the viewer by random hands: soak MINUTES FILE...
// Draws without a window: turns, zooms, flies, clicks and drags in the panel (attributes, transfer functions, budgets),
// changes the window's size, opens the files in turn, rests. Every ten seconds it closes the viewer and its context of
// OpenGL, and then looks at the memory and the open handles of the process. A minute's memory is the least that is seen
// in it: what stays, without what is held for a moment. Fails if memory grows by more than 3 MiB from the first half of
// the minutes to the second, or if there is a handle more.
#include <fmt/format.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>
#include <string_view>

#include "renderer/gl/context.h"
#include "renderer/gl/target.h"
#include "tools/command_line.h"
#include "tools/tool.h"
#include "viewer/viewer.h"

namespace splatvol {
namespace {

constexpr double seconds_of_a_viewer = 10;
constexpr double most_growth = 3;  // MiB, from the first half to the second: a first minute may be of few viewers
constexpr double frame_seconds = 1.0 / 60;

struct Holdings {
  double memory = 0;  // resident, MiB
  std::ptrdiff_t handles = 0;
};

Holdings holdings() {
  ::malloc_trim(0);
  std::size_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> pages;
  const std::filesystem::directory_iterator handles("/proc/self/fd");
  return {static_cast<double>(pages) * static_cast<double>(::sysconf(_SC_PAGESIZE)) / (1 << 20),
          std::distance(begin(handles), end(handles))};
}

// What a user does, a frame at a time.
class Hands {
 public:
  explicit Hands(const std::vector<std::string>& files) : files_(files) {}

  // The first event of a viewer.
  Event any_size() {
    size_.width = whole(1, 10) == 1 ? whole(1, 900) : 600;
    size_.height = whole(1, 10) == 1 ? whole(1, 700) : 400;
    size_.pixel_width = size_.width;
    size_.pixel_height = size_.height;
    size_.content_scale = whole(1, 4) == 1 ? 1.5 : 1;
    return size_;
  }

  // Events of the next frame; none while the hands rest.
  std::vector<Event> next() {
    if (frames_left_ == 0) begin();
    --frames_left_;
    std::vector<Event> events;
    switch (act_) {
      case Act::rest:
        break;
      case Act::drag:
        at_ += step_;
        events.push_back(PointerMoved{at_.x, at_.y});
        if (frames_left_ == frames_ - 1) events.push_back(ButtonChanged{button_, true});
        if (frames_left_ == 0) events.push_back(ButtonChanged{button_, false});
        break;
      case Act::scroll:
        events.push_back(Scrolled{0, step_.x > 0 ? 1.0 : -1.0});
        break;
      case Act::key:
        if (frames_left_ == frames_ - 1) events.push_back(KeyChanged{key_, true});
        if (frames_left_ == 0) events.push_back(KeyChanged{key_, false});
        break;
      case Act::resize:
        events.push_back(any_size());
        break;
      case Act::open:
        events.push_back(FilesDropped{{files_[opened_++ % files_.size()]}});
        break;
    }
    return events;
  }

 private:
  enum class Act { rest, drag, scroll, key, resize, open };

  void begin() {
    const int chance = whole(0, 99);
    act_ = chance < 40   ? Act::drag
           : chance < 55 ? Act::scroll
           : chance < 75 ? Act::key
           : chance < 92 ? Act::rest
           : chance < 96 ? Act::open
                         : Act::resize;
    const bool is_long = act_ == Act::drag || act_ == Act::key || act_ == Act::rest || act_ == Act::scroll;
    frames_ = frames_left_ = is_long ? whole(2, 40) : 1;
    at_ = {whole(0, size_.width), whole(0, size_.height)};
    step_ = {whole(-6, 6), whole(-6, 6)};
    button_ = whole(0, 9) < 7 ? 0 : whole(1, 2);
    constexpr std::string_view letters = "ABCDEFGHIJKLMNOPRSTUVWXYZ123 ";  // not Q, which flies, but also closes
    const int others[] = {key::left, key::right, key::up, key::down, key::tab, key::f1, key::escape, key::left_shift};
    key_ = whole(0, 2) > 0 ? letters[static_cast<std::size_t>(whole(0, static_cast<int>(letters.size()) - 1))]
                           : others[whole(0, static_cast<int>(std::size(others)) - 1)];
  }

  int whole(int low, int high) { return std::uniform_int_distribution(low, std::max(low, high))(random_); }

  const std::vector<std::string>& files_;
  std::size_t opened_ = 0;
  std::mt19937 random_{1};
  WindowResized size_{600, 400, 600, 400, 1};
  Act act_ = Act::rest;
  int frames_ = 0, frames_left_ = 0;
  dvec2 at_{0}, step_{0};
  int button_ = 0, key_ = 0;
};

// Uses a viewer until `end`, in seconds_now(). Counts its frames.
Status use_viewer(Hands& hands, const std::string& file, Device device, double end, std::uint64_t& frames) {
  SPLATVOL_TRY_ASSIGN(context, HeadlessContext::create());
  ViewerOptions options{file, "", {}};
  options.settings.memory = std::uint64_t{64} << 20;
  options.settings.gpu_memory = std::uint64_t{256} << 20;
  options.settings.device = device;
  SPLATVOL_TRY_ASSIGN(viewer, Viewer::create(options));
  Target target;
  FrameInput input{frame_seconds, {hands.any_size()}};
  WindowResized size{};
  while (seconds_now() < end) {
    for (const Event& event : input.events)
      if (const auto* resized = std::get_if<WindowResized>(&event)) size = *resized;
    SPLATVOL_TRY(target.resize(size.pixel_width, size.pixel_height));
    target.use();
    SPLATVOL_TRY(viewer->frame(input));
    ++frames;
    input.events = hands.next();
  }
  return {};
}

Status soak(int minutes, const std::vector<std::string>& files) {
  if (minutes < 2) return fail(ErrorCode::invalid_argument, "a minute has no halves to compare: give 2 or more");
  Hands hands(files);
  Holdings first, second;  // the most of any minute in each half
  std::uint64_t frames = 0, viewers = 0;
  fmt::print("  minute    frames  viewers  MiB without one  handles\n");
  const double start = seconds_now();
  for (int minute = 1; minute <= minutes; ++minute) {
    Holdings held{std::numeric_limits<double>::infinity(), 0};
    while (seconds_now() < start + 60 * minute) {
      const Device device = viewers % 2 == 0 ? Device::cpu : Device::gl;
      SPLATVOL_TRY(
          use_viewer(hands, files[viewers % files.size()], device, seconds_now() + seconds_of_a_viewer, frames));
      ++viewers;
      const Holdings now = holdings();
      held = {std::min(held.memory, now.memory), std::max(held.handles, now.handles)};
    }
    Holdings& half = 2 * minute <= minutes + 1 ? first : second;
    half = {std::max(half.memory, held.memory), std::max(half.handles, held.handles)};
    fmt::print("{:8.1f} {:9} {:8} {:16.1f} {:8}\n", (seconds_now() - start) / 60, frames, viewers, held.memory,
               held.handles);
    std::fflush(stdout);
  }
  fmt::print("at most {:.1f} MiB and {} handles in the first half, {:.1f} MiB and {} handles in the second\n",
             first.memory, first.handles, second.memory, second.handles);
  if (second.handles > first.handles) return fail(ErrorCode::invalid_data, "handles are left open");
  if (second.memory > first.memory + most_growth)
    return fail(ErrorCode::invalid_data, "memory grew by more than {} MiB", most_growth);
  return {};
}

// What is saved from the panel lands in a folder that is removed.
Status run(int minutes, std::vector<std::string> files) {
  for (std::string& file : files) file = std::filesystem::absolute(file).string();
  std::string folder = (std::filesystem::temp_directory_path() / "splatvol-soak-XXXXXX").string();
  if (!::mkdtemp(folder.data())) return fail(ErrorCode::io, "{}: no folder can be made", folder);
  std::filesystem::current_path(folder);
  Status soaked = soak(minutes, files);
  std::filesystem::current_path("/");
  std::filesystem::remove_all(folder);
  return soaked;
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  CommandLine app("Uses the viewer at random, and watches the memory and the handles of the process.", "soak");
  int minutes = 1;
  std::vector<std::string> files;
  app.add_option("minutes", minutes, "how long")->required()->check(check_positive);
  app.add_option("files", files, ".svol files, opened in turn")->required();
  return run_tool(app, argc, argv, [&] { return run(minutes, files); });
}
