// A web server that does as it is told, and misbehaves so.
#pragma once

#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace splatvol::test {

/// What happens to one request: `text`, header and body, is sent as it is; then the connection is kept, closed, reset
/// or left alone until the client gives it up.
struct Reply {
  enum class Then { keep, close, reset, stall };
  std::string text;
  Then then = Then::keep;
};

/// Answers requests on a loopback port, one connection after another: the n-th request with the n-th reply, and those
/// after the last with the last.
class ScriptedServer {
 public:
  /// Requires at least one reply.
  explicit ScriptedServer(std::vector<Reply> replies);
  ScriptedServer(const ScriptedServer&) = delete;
  ScriptedServer& operator=(const ScriptedServer&) = delete;
  ~ScriptedServer();

  [[nodiscard]] int port() const { return port_; }

  /// "http://127.0.0.1:PORT/NAME".
  [[nodiscard]] std::string url(const std::string& name) const;

  /// Headers of the requests so far.
  [[nodiscard]] std::vector<std::string> requests() const;

 private:
  void serve();
  void converse(int connection);

  const std::vector<Reply> replies_;
  int listener_ = -1;
  int port_ = 0;
  mutable std::mutex mutex_;
  std::vector<std::string> requests_;
  int connection_ = -1;  // at work
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace splatvol::test
