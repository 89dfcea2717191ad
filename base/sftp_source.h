// Files on machines that ssh reaches, read range by range over SFTP.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "base/server_file.h"

namespace splatvol {

/// How a source reaches its server, and how long it waits.
struct SftpOptions {
  std::vector<std::string> command = {};                          // of a program that speaks SFTP; empty: ssh
  std::chrono::milliseconds connect_timeout{120'000};             // meanwhile somebody may type a password
  std::chrono::milliseconds stall_timeout = usual_stall_timeout;  // longest time in which no read ends
};

/// The parts of an address, ssh://[USER@]HOST[:PORT]/PATH.
struct SshAddress {
  std::string user = {}, host = {}, port = {};  // empty if it names none
  std::string path = {};  // without its codes (%20); not absolute: from the home folder on (/~/PATH)
  std::string name = {};  // the address without user
};

/// Fails if it is no such address, or if ssh or a shell could take a part for something else. A password is refused.
[[nodiscard]] Result<SshAddress> parse_ssh_address(const std::string& url);

/// Returns the words of a command for ssh that starts the server's sftp. `may_ask`: for a password.
[[nodiscard]] std::vector<std::string> ssh_command(const SshAddress& address, bool may_ask);

/// Opens the file at an address. Reads its first 32 KiB and keeps them. Fails if ssh does not reach the host or is not
/// installed, or if the host does not have the file.
///
/// The program ssh of the user connects, with its configuration, keys and known hosts. It asks for a password if there
/// is a terminal. All reads share its connection: up to 32 are on their way, also of several threads. If the connection
/// is lost, one more is made, and these reads are tried once more. Then a read fails. All reads fail if the new
/// connection fails, or if the file has changed meanwhile: its size or its time differs. Trusts nothing that the server
/// says. Heeds base/interruption.h. ssh ends with the source.
///
/// The source's name, and so its messages, leave out the user.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> open_ssh(const std::string& url, const SftpOptions& options = {});

}  // namespace splatvol
