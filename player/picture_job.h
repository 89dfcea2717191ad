// A picture that is drawn beside the window.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "base/error.h"
#include "player/player.h"
#include "player/session_host.h"
#include "streamer/splats/streamer.h"

namespace splatvol {

/// What is told of the last picture while the next one is drawn.
struct LastPicture {
  explicit LastPicture(Player& player);
  LastPicture() = default;

  std::optional<FrameSplats> frame = {};  // without its list
  std::optional<ExactPicture> exact = {};
  std::vector<DrawnNode> nodes = {};
  StreamerStatistics statistics = {};
  bool is_reading_ahead = false;
  std::optional<Error> left_out = {};
  std::optional<SharedCells> cells = {};  // for picks
  std::vector<Surface> surfaces = {};
};

/// Draws a picture, or makes ready for others. Until it ends, nothing else changes the player.
class PictureJob {
 public:
  enum class Work { moving, refining, making_ready };

  [[nodiscard]] bool is_begun() const { return drawing_.is_begun(); }
  [[nodiscard]] Work work() const { return work_; }
  [[nodiscard]] const LastPicture& last() const { return last_; }

  void begin(SessionHost& host, Work work, Player& player, std::function<Status()> draw);

  // As Task. Require is_begun().
  [[nodiscard]] bool wait(double seconds = 0) const { return drawing_.wait(seconds); }
  [[nodiscard]] Status take() { return drawing_.take(); }
  void interrupt() { drawing_.interrupt(); }

  /// Returns the time of the last job, once. 0: there was none.
  [[nodiscard]] double take_seconds();

 private:
  Work work_ = Work::moving;
  LastPicture last_;
  double seconds_ = 0;  // written by the job
  Task<Status> drawing_;
};

}  // namespace splatvol
