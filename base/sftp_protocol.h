// The protocol of SFTP servers, version 3 (draft-ietf-secsh-filexfer-02), as far as a file is read. No input, no
// output.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <variant>
#include <vector>

#include "base/error.h"

namespace splatvol {

/// Each server can do so much (section 3): bytes of a read, and of a packet behind its length.
inline constexpr std::size_t most_sftp_read_bytes = 32768;
inline constexpr std::size_t most_sftp_packet_bytes = 34000;

/// Packets to a server. `id`: comes back in the answer.
[[nodiscard]] std::string sftp_init();
[[nodiscard]] std::string sftp_open(std::uint32_t id, std::string_view path);
[[nodiscard]] std::string sftp_fstat(std::uint32_t id, std::string_view handle);
[[nodiscard]] std::string sftp_read(std::uint32_t id, std::string_view handle, std::uint64_t offset, std::size_t bytes);

/// Packets from a server. Spans and views lie in the packet.
struct SftpVersion {
  std::uint32_t version;
};
struct SftpStatus {
  std::uint32_t id, code;
  std::string_view message;  // of the server, in any bytes; may be empty
  static constexpr std::uint32_t end_of_file = 1, no_such_file = 2, permission_denied = 3;
};
struct SftpHandle {
  std::uint32_t id;
  std::string_view handle;
};
struct SftpData {
  std::uint32_t id;
  std::span<const std::byte> bytes;
};
struct SftpAttributes {
  std::uint32_t id;
  std::optional<std::uint64_t> size = {};
  std::optional<std::uint32_t> permissions = {};  // as st_mode
  std::optional<std::uint32_t> changed = {};      // seconds, as st_mtime
};
using SftpAnswer = std::variant<SftpVersion, SftpStatus, SftpHandle, SftpData, SftpAttributes>;

/// Reads a packet without its length. Fails unless it is one of these, as a whole. Safe on untrusted bytes.
[[nodiscard]] Result<SftpAnswer> parse_sftp_answer(std::span<const std::byte> packet);

/// Returns the words of a status.
[[nodiscard]] std::string text_of(const SftpStatus& status);

/// Cuts what a server sends into answers.
class SftpAnswers {
 public:
  /// Takes more bytes. Invalidates the answers so far.
  void add(std::span<const std::byte> bytes);

  /// Returns the next answer; none if its bytes have not all come. Fails if it breaks the protocol, or would be longer
  /// than any that is asked for. Once this returns none, less than a packet is kept.
  [[nodiscard]] Result<std::optional<SftpAnswer>> next();

 private:
  std::vector<std::byte> bytes_;
  std::size_t begin_ = 0;  // of those that are not returned yet
};

/// Reads of a file that wait for their answers. Not thread-safe.
class SftpReads {
 public:
  /// Reads that end together.
  struct Group {
    std::size_t left = 0;               // reads without a whole answer
    std::optional<Error> failure = {};  // without the name of the file; then none is left
    int losses = 0;                     // of connections
  };

  /// Asks for the bytes at `offset`. `out` and `group` stay until no read of the group is left, or forget().
  void add(std::uint64_t offset, std::span<std::byte> out, Group& group);

  /// Returns packets for reads that are not on their way yet; "" if there are none, or 32 are on their way.
  [[nodiscard]] std::string take_packets(std::string_view handle);

  /// Takes an answer. Returns whether it is the last one of a read. A read that came short goes on behind its bytes. A
  /// server's refusal fails the group. Fails if no such answer may come.
  [[nodiscard]] Result<bool> take(const SftpAnswer& answer);

  /// Whether answers are to come.
  [[nodiscard]] bool are_awaited() const { return !on_their_way_.empty(); }

  /// Forgets what waits for answers, when a connection is lost: these reads are asked for anew, unless their group has
  /// lost two. Then it fails with the reason.
  void lose_answers(const Error& reason);

  /// Fails all groups.
  void fail_all(const Error& reason);

  /// Takes back the reads of a group, and leaves its `out` alone from now on.
  void forget(Group& group);

 private:
  struct Read {
    std::uint64_t offset;
    std::span<std::byte> out;
    Group* group;       // null: nobody waits any more
    std::size_t asked;  // bytes of the request
  };
  void fail_group(Group& group, const Error& reason);

  std::deque<Read> waiting_;
  std::unordered_map<std::uint32_t, Read> on_their_way_;  // by id
  std::uint32_t last_id_ = 0;
};

}  // namespace splatvol
