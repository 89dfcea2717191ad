#include "builder/sources/process/channel.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

namespace splatvol {
namespace {

constexpr std::size_t buffer_bytes = std::size_t{1} << 16;
constexpr int tick_milliseconds = 100;

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

Status Channel::send_now(std::span<const std::byte> bytes) {
  // Who has nothing to look at meanwhile lets the kernel wait.
  const int flags = MSG_NOSIGNAL | (waiting_ ? MSG_DONTWAIT : 0);
  while (!bytes.empty()) {
    if (waiting_) SPLATVOL_TRY(wait(POLLOUT));
    const ssize_t put = ::send(descriptor_, bytes.data(), bytes.size(), flags);
    if (put < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (put < 0) return fail_ended();
    bytes = bytes.subspan(static_cast<std::size_t>(put));
  }
  return {};
}

Status Channel::wait(short event) {
  for (;;) {
    // Also while bytes come: one now and then must not put off the end.
    if (const auto now = std::chrono::steady_clock::now(); waiting_ && now >= next_look_) {
      SPLATVOL_TRY(waiting_());
      next_look_ = now + std::chrono::milliseconds(tick_milliseconds);
    }
    pollfd waited{descriptor_, event, 0};
    const int ready = ::poll(&waited, 1, waiting_ ? tick_milliseconds : -1);
    if (ready > 0) return {};
    if (ready < 0 && errno != EINTR) return fail(ErrorCode::io, "poll: {}", std::system_category().message(errno));
  }
}

Status Channel::receive(std::span<std::byte> bytes) {
  while (!bytes.empty()) {
    SPLATVOL_TRY(wait(POLLIN));
    const ssize_t got = ::recv(descriptor_, bytes.data(), bytes.size(), 0);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return fail_ended();
    bytes = bytes.subspan(static_cast<std::size_t>(got));
    received_ += static_cast<std::uint64_t>(got);
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

Status Channel::get(std::string& text) { return get(text, most_bytes_); }

Status Channel::get(std::string& text, std::uint64_t most_bytes) {
  SPLATVOL_TRY_ASSIGN(count, get_count(1));
  if (count > most_bytes)
    return fail(ErrorCode::invalid_data, "a text of {} bytes, and {} are allowed", count, most_bytes);
  return get_elements(text, count);
}

Result<std::size_t> Channel::get_count(std::size_t element_bytes) {
  std::uint64_t count = 0;
  SPLATVOL_TRY(get(count));
  if (count > most_bytes_ / element_bytes)
    return fail(ErrorCode::out_of_budget, "{} elements of {} bytes, and {} may be held", count, element_bytes,
                most_bytes_);
  return static_cast<std::size_t>(count);
}

std::size_t Channel::next_size(std::size_t count, std::size_t arrived, std::size_t element_bytes) {
  // Few steps, and the last one holds little more than the whole: a quarter of it is copied.
  constexpr std::size_t growth = 4;
  const std::size_t most = std::max(arrived * growth, buffer_bytes / element_bytes + 1);
  std::size_t size = count;
  while (size > most) size = (size + growth - 1) / growth;
  return size;
}

}  // namespace splatvol
