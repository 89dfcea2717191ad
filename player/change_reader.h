// Reads what a change needs, beside pictures.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "base/error.h"
#include "player/player.h"
#include "player/session_file.h"
#include "player/session_host.h"
#include "scene/scene.h"

namespace splatvol {

/// Reads what a change of scene, settings or step needs and that is not there.
class ChangeReader {
 public:
  std::optional<std::size_t> step;  // that is asked for, and is still to be read
  bool fits_function = false;       // the scene's attribute is to get the function that fits it
  bool fits_opacity = false;        // the opacity likewise

  [[nodiscard]] bool is_begun() const { return file_.is_begun(); }

  /// Begins to read, unless it reads the same already. Returns false if nothing needs reading.
  [[nodiscard]] bool begin(SessionHost& host, const Player& player, const std::string& path, const Scene& scene,
                           const ViewSettings& settings);

  /// Whether it is there. Requires is_begun().
  [[nodiscard]] bool is_done() const { return file_.wait(); }
  [[nodiscard]] Result<SessionFile> take() { return file_.take(); }

  /// Reads no more, and waits for the thread.
  void end() { file_.end(); }

 private:
  // What it reads for.
  Scene scene_ = {};
  ViewSettings settings_ = {};
  std::optional<std::size_t> reads_step_ = {};
  Task<Result<SessionFile>> file_;
};

}  // namespace splatvol
