#include "builder/sources/process/channel.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace splatvol {
namespace {

constexpr std::size_t buffer_bytes = std::size_t{1} << 16;
constexpr int tick_milliseconds = 1000;

tl::unexpected<Error> fail_ended() { return fail(ErrorCode::io, "the other process has ended"); }

}  // namespace

Channel::~Channel() { ::close(descriptor_); }

Status Channel::send(std::span<const std::byte> bytes) {
  if (unsent_.size() + bytes.size() > buffer_bytes) SPLATVOL_TRY(flush());
  if (bytes.size() >= buffer_bytes) return send_now(bytes);
  unsent_.insert(unsent_.end(), bytes.begin(), bytes.end());
  return {};
}

Status Channel::flush() {
  Status sent = send_now(unsent_);
  unsent_.clear();
  return sent;
}

Status Channel::send_now(std::span<const std::byte> bytes) const {
  while (!bytes.empty()) {
    const ssize_t put = ::send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) return fail_ended();
    bytes = bytes.subspan(static_cast<std::size_t>(put));
  }
  return {};
}

Status Channel::wait() {
  for (;;) {
    pollfd waited{descriptor_, POLLIN, 0};
    const int ready = ::poll(&waited, 1, waiting_ ? tick_milliseconds : -1);
    if (ready > 0) return {};
    if (ready < 0 && errno != EINTR) return fail(ErrorCode::io, "poll: {}", std::system_category().message(errno));
    if (ready == 0) SPLATVOL_TRY(waiting_());
  }
}

Status Channel::receive(std::span<std::byte> bytes) {
  while (!bytes.empty()) {
    SPLATVOL_TRY(wait());
    const ssize_t got = ::recv(descriptor_, bytes.data(), bytes.size(), 0);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return fail_ended();
    bytes = bytes.subspan(static_cast<std::size_t>(got));
  }
  return {};
}

Status Channel::put(const std::string& text) {
  SPLATVOL_TRY(put(std::uint64_t{text.size()}));
  return send(std::as_bytes(std::span(text)));
}

Status Channel::get(bool& value) {
  std::uint8_t byte = 0;
  SPLATVOL_TRY(get(byte));
  value = byte != 0;
  return {};
}

Status Channel::get(std::string& text) {
  SPLATVOL_TRY_ASSIGN(count, get_count(1));
  text.resize(count);
  return receive(std::as_writable_bytes(std::span(text)));
}

Result<std::size_t> Channel::get_count(std::size_t element_bytes) {
  std::uint64_t count = 0;
  SPLATVOL_TRY(get(count));
  if (count > most_bytes_ / element_bytes)
    return fail(ErrorCode::out_of_budget, "{} elements of {} bytes, and {} may be held", count, element_bytes,
                most_bytes_);
  return static_cast<std::size_t>(count);
}

}  // namespace splatvol
