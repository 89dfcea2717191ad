// A web server for tests: nginx, on a free loopback port, without root.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>

namespace splatvol::test {

/// Serves the files of a folder at /, and at /plain/ without support for ranges. Ends when it is destroyed, or when
/// this process ends in any way. Writes a line for each answer, "STATUS BYTES RANGE", to access.log in the folder.
class Nginx {
 public:
  /// Starts nginx and waits until it listens. Returns null if this machine has no nginx. Throws if nginx does not
  /// start.
  [[nodiscard]] static std::unique_ptr<Nginx> start(const std::string& folder);
  Nginx(const Nginx&) = delete;
  Nginx& operator=(const Nginx&) = delete;
  ~Nginx();

  /// Returns the address of a file of the folder: "http://127.0.0.1:PORT/NAME".
  [[nodiscard]] std::string url(const std::string& name) const;

 private:
  Nginx(pid_t process, int port) : process_(process), port_(port) {}

  pid_t process_;
  int port_;
};

}  // namespace splatvol::test
