// Draws what callers of the library ask for, and tells what it cost.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "base/clock.h"
#include "player/player.h"
#include "splatvol/renderer.h"

namespace splatvol {

/// A player behind the calls of the public face. Its calls come from the thread that the player belongs to.
class RendererCore {
 public:
  [[nodiscard]] static Result<std::unique_ptr<RendererCore>> open(const std::string& path,
                                                                  const std::optional<Scene>& scene,
                                                                  const RendererOptions& options,
                                                                  bool in_current_context);

  // As in Renderer.
  [[nodiscard]] Status draw(const Quality& quality);
  [[nodiscard]] Status draw_now(double wait_seconds, const Quality& quality);
  [[nodiscard]] Result<Scene> fitting_scene(const std::string& attribute, int width, int height) const;
  [[nodiscard]] const RenderStatistics& statistics() const { return statistics_; }

  [[nodiscard]] Player& player() { return *player_; }
  [[nodiscard]] const Player& player() const { return *player_; }

 private:
  explicit RendererCore(std::unique_ptr<Player> player) : player_(std::move(player)) {}
  // `search`: what comparing pictures found out, if they were compared.
  void take_statistics(Clock::time_point start, const std::optional<ErrorSearch>& search);

  std::unique_ptr<Player> player_;
  RenderStatistics statistics_;
};

}  // namespace splatvol
