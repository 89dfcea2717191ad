// A web server for tests: nginx, on a free loopback port, without root.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>

namespace splatvol::test {

/// Serves the files of a folder at /, and again at /plain/ without support for ranges, until it is destroyed (or this
/// process ends, however it does). Its log is in the folder: access.log, a line for each answer, "STATUS BYTES RANGE".
class Nginx {
 public:
  /// Returns when it listens; null where there is no nginx on this machine. Throws where it does not start.
  [[nodiscard]] static std::unique_ptr<Nginx> start(const std::string& folder);
  Nginx(const Nginx&) = delete;
  Nginx& operator=(const Nginx&) = delete;
  ~Nginx();

  /// Address of a file of the folder: "http://127.0.0.1:PORT/NAME".
  [[nodiscard]] std::string url(const std::string& name) const;

 private:
  Nginx(pid_t process, int port) : process_(process), port_(port) {}

  pid_t process_;
  int port_;
};

}  // namespace splatvol::test
