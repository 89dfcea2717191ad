#include "tests/support/scripted_server.h"

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <string_view>
#include <utility>

#include "tests/support/loopback.h"

namespace splatvol::test {
namespace {

// Returns the header of the next request; "" if the client is done.
std::string receive_header(int connection) {
  std::string header;
  std::array<char, 1> byte{};
  while (!header.ends_with("\r\n\r\n")) {
    if (::recv(connection, byte.data(), 1, 0) <= 0) return "";
    header += byte[0];
  }
  return header;
}

// Returns whether the client took all of it.
bool send_all(int connection, std::string_view text) {
  while (!text.empty()) {
    const ssize_t sent = ::send(connection, text.data(), text.size(), MSG_NOSIGNAL);
    if (sent <= 0) return false;
    text.remove_prefix(static_cast<std::size_t>(sent));
  }
  return true;
}

void send_for_ever(int connection, std::string_view text, std::chrono::milliseconds pause) {
  while (send_all(connection, text)) std::this_thread::sleep_for(pause);
}

}  // namespace

ScriptedServer::ScriptedServer(std::vector<Reply> replies) : replies_(std::move(replies)) {
  const Listener listener = listen_on_loopback();
  listener_ = listener.descriptor;
  port_ = listener.port;
  thread_ = std::thread([this] { serve(); });
}

ScriptedServer::~ScriptedServer() {
  {
    const std::scoped_lock lock(mutex_);
    ending_ = true;
    ::shutdown(listener_, SHUT_RDWR);
    ::shutdown(connection_, SHUT_RDWR);
  }
  thread_.join();
  ::close(listener_);
}

std::string ScriptedServer::url(const std::string& name) const {
  return fmt::format("http://127.0.0.1:{}/{}", port_, name);
}

std::vector<std::string> ScriptedServer::requests() const {
  const std::scoped_lock lock(mutex_);
  return requests_;
}

void ScriptedServer::serve() {
  for (;;) {
    const int connection = ::accept(listener_, nullptr, nullptr);
    std::unique_lock lock(mutex_);
    connection_ = connection;
    if (!ending_ && connection >= 0) {
      lock.unlock();
      converse(connection);
      lock.lock();
    }
    connection_ = -1;
    ::close(connection);
    if (ending_) return;
  }
}

void ScriptedServer::converse(int connection) {
  for (;;) {
    std::string header = receive_header(connection);
    if (header.empty()) return;
    std::size_t index = 0;
    {
      const std::scoped_lock lock(mutex_);
      index = std::min(requests_.size(), replies_.size() - 1);
      requests_.push_back(std::move(header));
    }
    const Reply& reply = replies_[index];
    send_all(connection, reply.text);
    if (reply.then == Reply::Then::close) return;
    if (reply.then == Reply::Then::reset) {
      constexpr linger at_once{1, 0};
      ::setsockopt(connection, SOL_SOCKET, SO_LINGER, &at_once, sizeof(at_once));
      return;
    }
    if (reply.then == Reply::Then::drip) send_for_ever(connection, "x", std::chrono::milliseconds(100));
    if (reply.then == Reply::Then::repeat) send_for_ever(connection, reply.text, std::chrono::milliseconds(1));
    if (reply.then == Reply::Then::stall) receive_header(connection);
    if (reply.then != Reply::Then::keep) return;
  }
}

}  // namespace splatvol::test
