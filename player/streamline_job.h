// Follows streamlines beside pictures.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "player/player.h"
#include "player/scene_streamlines.h"
#include "player/session_host.h"
#include "scene/scene.h"

namespace splatvol {

/// Follows the streamlines of a scene as it changes, and gives them away as they come.
class StreamlineJob {
 public:
  /// Begins to follow these streamlines at the player's step, unless they are there or on their way. Others that are on
  /// their way have a little time, so that lines are seen while seeds are dragged.
  void follow(SessionHost& host, const Player& player, const std::vector<SceneStreamlines>& streamlines);

  /// Whether some are on their way.
  [[nodiscard]] bool is_begun() const { return task_.is_begun(); }

  /// Whether there is something to take.
  [[nodiscard]] bool has_news() const;

  /// Returns the tubes that have come since the last call; none: nothing has. If streamlines cannot be followed, no
  /// tubes, and `trouble` tells why.
  [[nodiscard]] std::optional<std::vector<SceneTubes>> take(std::optional<Error>& trouble);

  /// Follows no more, and waits for the thread.
  void end() { task_.end(); }

 private:
  // Followed, or were.
  struct Asked {
    std::vector<SceneStreamlines> streamlines = {};
    std::string file = {};  // a step may be one
    std::shared_ptr<const PlayerMemory> memory = {};
    std::uint64_t step_key = 0;

    [[nodiscard]] bool operator==(const Asked&) const = default;
  };
  struct News {
    std::mutex mutex = {};
    std::optional<std::vector<SceneTubes>> tubes = {};
  };

  Asked asked_;
  double begun_ = 0;
  std::shared_ptr<News> news_ = std::make_shared<News>();
  Task<Result<std::vector<SceneTubes>>> task_;
};

}  // namespace splatvol
