// A file that is being opened for the window, on a thread of its own.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <stop_token>
#include <string>

#include "base/error.h"
#include "player/session.h"

namespace splatvol {

class Opening {
 public:
  /// Begins to open a volume with a scene, as `Session::read`.
  Opening(SessionHost& host, const SceneUse& asked, const std::string& scene_path, const ViewSettings& settings);
  Opening(const Opening&) = delete;
  Opening& operator=(const Opening&) = delete;

  /// Cancels it. A read from a server in progress ends within a tenth of a second.
  ~Opening() { stop_.request_stop(); }

  /// Returns the path of the volume, or of the scene that names it.
  [[nodiscard]] const std::string& path() const { return path_; }

  /// Returns the bytes that have been read so far.
  [[nodiscard]] std::uint64_t bytes_read() const { return *bytes_read_; }

  /// Waits for the end up to a time. Returns whether it has ended.
  [[nodiscard]] bool wait(double seconds) const { return file_.wait(seconds); }

  /// Waits for the end. Called once.
  [[nodiscard]] Result<SessionFile> take() { return file_.take(); }

 private:
  std::string path_;
  std::shared_ptr<std::atomic<std::uint64_t>> bytes_read_ = std::make_shared<std::atomic<std::uint64_t>>(0);
  std::stop_source stop_;
  Task<Result<SessionFile>> file_;
};

}  // namespace splatvol
