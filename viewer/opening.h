// A file that is being opened for the window, on a thread of its own.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>

#include "base/error.h"
#include "player/session.h"

namespace splatvol {

class Opening {
 public:
  /// Begins to open a volume, or a mesh, with a scene, as `Session::read`. `all_steps`: of a mesh.
  Opening(SessionHost& host, const SceneUse& asked, const std::string& scene_path, const ViewSettings& settings,
          bool all_steps = false);
  Opening(const Opening&) = delete;
  Opening& operator=(const Opening&) = delete;

  /// Cancels it. A read from a server in progress, and a conversion, end within a tenth of a second.
  ~Opening();

  /// Returns the path of the volume, or of the scene that names it.
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const SceneUse& asked() const { return asked_; }

  /// Returns the bytes that have been read so far.
  [[nodiscard]] std::uint64_t bytes_read() const { return *bytes_read_; }

  /// Returns how far a mesh is converted; none before that begins, and if there is none.
  [[nodiscard]] std::optional<ConversionProgress> conversion() const;

  /// Opens the file of some points of a mesh, which is there before the whole one. Null if it is not there, and after
  /// the first call that returns it.
  [[nodiscard]] std::unique_ptr<Opening> open_preview(SessionHost& host);

  /// Removes that file, once it is open or not wanted.
  void end_preview();

  /// Waits for the end up to a time. Returns whether it has ended.
  [[nodiscard]] bool wait(double seconds) const { return file_.wait(seconds); }

  /// Waits for the end. Called once.
  [[nodiscard]] Result<SessionFile> take() { return file_.take(); }

 private:
  // What the thread tells.
  struct Told {
    std::mutex mutex;
    std::optional<ConversionProgress> conversion;
  };

  std::string path_;
  SceneUse asked_;
  std::string scene_path_;
  ViewSettings settings_;
  std::string preview_;  // the path of its file; empty: there is none
  bool is_preview_begun_ = false;
  std::shared_ptr<Told> told_ = std::make_shared<Told>();
  std::shared_ptr<std::atomic<std::uint64_t>> bytes_read_ = std::make_shared<std::atomic<std::uint64_t>>(0);
  Task<Result<SessionFile>> file_;
};

}  // namespace splatvol
