// Packets of an SFTP server, as tests send them.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace splatvol::test {

inline std::string sftp_number(std::uint64_t value, int bytes = 4) {
  std::string text;
  for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8) text += static_cast<char>(value >> shift & 0xff);
  return text;
}

inline std::string sftp_text(std::string_view text) { return sftp_number(text.size()) + std::string(text); }

/// `type`: of the packet; `number`: its id, or the version.
inline std::string sftp_packet(int type, std::uint32_t number, const std::string& rest = "") {
  return sftp_text(static_cast<char>(type) + sftp_number(number) + rest);
}

inline std::string version_answer(std::uint32_t version = 3) { return sftp_packet(2, version); }
inline std::string status_answer(std::uint32_t id, std::uint32_t code, const std::string& message = "") {
  return sftp_packet(101, id, sftp_number(code) + sftp_text(message) + sftp_text("en"));
}
inline std::string handle_answer(std::uint32_t id, const std::string& handle = "h") {
  return sftp_packet(102, id, sftp_text(handle));
}
inline std::string data_answer(std::uint32_t id, std::string_view bytes) {
  return sftp_packet(103, id, sftp_text(bytes));
}
/// Of a regular file.
inline std::string attributes_answer(std::uint32_t id, std::uint64_t size, std::uint32_t mode = 0100644,
                                     std::uint32_t changed = 1000) {
  constexpr std::uint32_t size_owner_permissions_times = 15;
  return sftp_packet(105, id,
                     sftp_number(size_owner_permissions_times) + sftp_number(size, 8) + sftp_number(0) +
                         sftp_number(0) + sftp_number(mode) + sftp_number(999) + sftp_number(changed));
}

/// What a server says until a file of a size is open.
inline std::string opening_answers(std::uint64_t size) {
  return version_answer() + handle_answer(1) + attributes_answer(2, size);
}

}  // namespace splatvol::test
