// A web server that sends the replies of a test, and so can misbehave.
#pragma once

#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace splatvol::test {

/// The reply to one request. The server sends `text`, header and body, as it is. Then it keeps, closes or resets the
/// connection; or until the client gives up, it waits, sends ten bytes a second, or sends `text` again and again.
struct Reply {
  enum class Then { keep, close, reset, stall, drip, repeat };
  std::string text;
  Then then = Then::keep;
};

/// Answers requests on a loopback port, one connection after another: the n-th request with the n-th reply, and later
/// requests with the last reply.
class ScriptedServer {
 public:
  /// Requires at least one reply.
  explicit ScriptedServer(std::vector<Reply> replies);
  ScriptedServer(const ScriptedServer&) = delete;
  ScriptedServer& operator=(const ScriptedServer&) = delete;
  ~ScriptedServer();

  [[nodiscard]] int port() const { return port_; }

  /// Returns "http://127.0.0.1:PORT/NAME".
  [[nodiscard]] std::string url(const std::string& name) const;

  /// Returns the headers of the requests so far.
  [[nodiscard]] std::vector<std::string> requests() const;

 private:
  void serve();
  void converse(int connection);

  const std::vector<Reply> replies_;
  int listener_ = -1;
  int port_ = 0;
  mutable std::mutex mutex_;
  std::vector<std::string> requests_;
  int connection_ = -1;  // that is being served
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace splatvol::test
