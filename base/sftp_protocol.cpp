#include "base/sftp_protocol.h"

#include <algorithm>
#include <concepts>
#include <cstring>
#include <utility>

namespace splatvol {
namespace {

constexpr std::uint32_t version = 3;
constexpr std::size_t most_on_their_way = 32;
constexpr std::size_t most_handle_bytes = 256;

// Types of packets (section 3).
enum Type : std::uint8_t {
  type_init = 1,
  type_version = 2,
  type_open = 3,
  type_read = 5,
  type_fstat = 8,
  type_status = 101,
  type_handle = 102,
  type_data = 103,
  type_attributes = 105
};

template <std::unsigned_integral T>
void put(std::string& packet, T value) {
  for (int shift = 8 * (static_cast<int>(sizeof(T)) - 1); shift >= 0; shift -= 8)
    packet += static_cast<char>(value >> shift & 0xff);
}

void put(std::string& packet, std::string_view text) {
  put(packet, static_cast<std::uint32_t>(text.size()));
  packet += text;
}

// Puts the length, the type and numbers or texts.
template <class... Fields>
std::string packet_of(Type type, const Fields&... fields) {
  std::string body(1, static_cast<char>(type));
  (put(body, fields), ...);
  std::string packet;
  put(packet, std::string_view(body));
  return packet;
}

// Takes fields from the front of a packet. A field that is not there is 0 or empty, and `is_whole` false from then on.
class Fields {
 public:
  explicit Fields(std::span<const std::byte> packet) : rest_(packet) {}

  template <std::unsigned_integral T>
  T take() {
    T value = 0;
    for (const std::byte byte : bytes(sizeof(T))) value = static_cast<T>(value << 8 | static_cast<T>(byte));
    return value;
  }
  std::span<const std::byte> bytes(std::size_t count) {
    is_whole = is_whole && count <= rest_.size();
    if (!is_whole) return {};
    const auto taken = rest_.first(count);
    rest_ = rest_.subspan(count);
    return taken;
  }
  std::span<const std::byte> text_bytes() { return bytes(take<std::uint32_t>()); }
  std::string_view text() {
    const auto taken = text_bytes();
    return {reinterpret_cast<const char*>(taken.data()), taken.size()};
  }
  [[nodiscard]] bool is_at_end() const { return rest_.empty(); }

  bool is_whole = true;

 private:
  std::span<const std::byte> rest_;
};

// Section 5. Skips what nobody asks for.
SftpAttributes take_attributes(std::uint32_t id, Fields& fields) {
  constexpr std::uint32_t has_size = 1, has_owner = 2, has_permissions = 4, has_times = 8;
  SftpAttributes attributes{id};
  const auto flags = fields.take<std::uint32_t>();
  if (flags & has_size) attributes.size = fields.take<std::uint64_t>();
  if (flags & has_owner) fields.bytes(8);
  if (flags & has_permissions) attributes.permissions = fields.take<std::uint32_t>();
  if (flags & has_times) {
    fields.bytes(4);
    attributes.changed = fields.take<std::uint32_t>();
  }
  return attributes;
}

tl::unexpected<Error> broken(const std::string& what) {
  return fail(ErrorCode::invalid_data, "the server breaks the protocol SFTP: {}", what);
}

}  // namespace

std::string sftp_init() { return packet_of(type_init, version); }

std::string sftp_open(std::uint32_t id, std::string_view path) {
  constexpr std::uint32_t for_reading = 1, no_attributes = 0;
  return packet_of(type_open, id, path, for_reading, no_attributes);
}

std::string sftp_fstat(std::uint32_t id, std::string_view handle) { return packet_of(type_fstat, id, handle); }

std::string sftp_read(std::uint32_t id, std::string_view handle, std::uint64_t offset, std::size_t bytes) {
  return packet_of(type_read, id, handle, offset, static_cast<std::uint32_t>(bytes));
}

Result<SftpAnswer> parse_sftp_answer(std::span<const std::byte> packet) {
  Fields fields(packet);
  const auto type = fields.take<std::uint8_t>();
  const auto number = fields.take<std::uint32_t>();  // the id, or the version
  SftpAnswer answer;
  // Texts may follow in a version and a status, and extensions in attributes.
  if (type == type_version) {
    answer = SftpVersion{number};
  } else if (type == type_status) {
    const auto code = fields.take<std::uint32_t>();
    answer = SftpStatus{number, code, fields.is_at_end() ? std::string_view() : fields.text()};
  } else if (type == type_handle) {
    answer = SftpHandle{number, fields.text()};
  } else if (type == type_data) {
    answer = SftpData{number, fields.text_bytes()};
  } else if (type == type_attributes) {
    answer = take_attributes(number, fields);
  } else {
    return broken(fmt::format("a packet of type {}", type));
  }
  if (!fields.is_whole) return broken("a packet ends too soon");
  const auto* handle = std::get_if<SftpHandle>(&answer);
  if (handle && handle->handle.size() > most_handle_bytes) return broken("a handle is too long");
  return answer;
}

std::string text_of(const SftpStatus& status) {
  if (status.code == SftpStatus::end_of_file) return "the file became shorter while it was open";
  if (status.code == SftpStatus::no_such_file) return "not found";
  if (status.code == SftpStatus::permission_denied) return "permission denied";
  return fmt::format("the server answers {}: {}", status.code, status.message.substr(0, 200));
}

void SftpAnswers::add(std::span<const std::byte> bytes) {
  bytes_.erase(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(std::exchange(begin_, 0)));
  bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
}

Result<std::optional<SftpAnswer>> SftpAnswers::next() {
  const auto rest = std::span<const std::byte>(bytes_).subspan(begin_);
  Fields fields(rest);
  const std::size_t length = fields.take<std::uint32_t>();
  if (!fields.is_whole) return std::nullopt;
  if (length > most_sftp_packet_bytes) {
    // A shell's start-up files that print get in front of the first packet.
    const auto is_text = [](std::byte byte) { return byte >= std::byte{' '} && byte <= std::byte{'~'}; };
    if (std::ranges::all_of(rest.first(4), is_text))
      return fail(ErrorCode::invalid_data, "the server sends a text in place of SFTP: does a start-up file print it?");
    return broken(fmt::format("a packet of {} bytes", length));
  }
  const auto packet = fields.bytes(length);
  if (!fields.is_whole) return std::nullopt;
  SPLATVOL_TRY_ASSIGN(answer, parse_sftp_answer(packet));
  begin_ += sizeof(std::uint32_t) + length;
  return answer;
}

void SftpReads::add(std::uint64_t offset, std::span<std::byte> out, Group& group) {
  while (!out.empty()) {
    const std::size_t bytes = std::min(out.size(), most_sftp_read_bytes);
    waiting_.push_back({offset, out.first(bytes), &group, bytes});
    ++group.left;
    offset += bytes;
    out = out.subspan(bytes);
  }
}

std::string SftpReads::take_packets(std::string_view handle) {
  std::string packets;
  while (!waiting_.empty() && on_their_way_.size() < most_on_their_way) {
    const Read& read = waiting_.front();
    while (on_their_way_.contains(++last_id_)) {
    }
    packets += sftp_read(last_id_, handle, read.offset, read.asked);
    on_their_way_.emplace(last_id_, read);
    waiting_.pop_front();
  }
  return packets;
}

Result<bool> SftpReads::take(const SftpAnswer& answer) {
  const auto* data = std::get_if<SftpData>(&answer);
  const auto* status = std::get_if<SftpStatus>(&answer);
  if (!data && !status) return broken("it answers something else than a read");
  const auto found = on_their_way_.find(data ? data->id : status->id);
  if (found == on_their_way_.end()) return broken("it answers what nobody asked for");
  Read read = found->second;
  if (data && data->bytes.empty()) return broken("an answer without bytes");
  if (data && data->bytes.size() > read.asked) return broken("it sends more bytes than were asked for");
  on_their_way_.erase(found);
  if (!read.group) return true;
  if (status) {
    fail_group(*read.group, Error{ErrorCode::io, text_of(*status)});
    return true;
  }
  std::ranges::copy(data->bytes, read.out.begin());
  const std::size_t came = data->bytes.size();
  if (came == read.asked) {
    --read.group->left;
    return true;
  }
  waiting_.push_front({read.offset + came, read.out.subspan(came), read.group, read.asked - came});
  return false;
}

void SftpReads::lose_answers(const Error& reason) {
  std::vector<Read> lost;
  for (const auto& [id, read] : on_their_way_)
    if (read.group) lost.push_back(read);
  on_their_way_.clear();
  std::ranges::sort(lost, {}, &Read::offset);
  waiting_.insert(waiting_.begin(), lost.begin(), lost.end());
  std::vector<Group*> groups;
  for (const Read& read : waiting_)
    if (std::ranges::find(groups, read.group) == groups.end()) groups.push_back(read.group);
  for (Group* group : groups)
    if (++group->losses == 2) fail_group(*group, reason);
}

void SftpReads::fail_all(const Error& reason) {
  while (!waiting_.empty()) fail_group(*waiting_.front().group, reason);
  for (auto& [id, read] : on_their_way_)
    if (read.group) fail_group(*read.group, reason);
}

void SftpReads::fail_group(Group& group, const Error& reason) {
  forget(group);
  group.failure = reason;
}

void SftpReads::forget(Group& group) {
  std::erase_if(waiting_, [&](const Read& read) { return read.group == &group; });
  for (auto& [id, read] : on_their_way_)
    if (read.group == &group) {
      read.group = nullptr;
      read.out = {};
    }
  group.left = 0;
}

}  // namespace splatvol
