// The SFTP server of OpenSSH for tests: they run it in place of ssh.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "tests/support/temp_folder.h"

namespace splatvol::test {

inline const std::string sftp_server = "/usr/lib/openssh/sftp-server";

/// Whether this machine has it.
inline bool has_sftp_server() { return ::access(sftp_server.c_str(), X_OK) == 0; }

inline constexpr const char* no_sftp_server = "no sftp-server on this machine (package openssh-sftp-server)";

/// Writes a program bin/ssh into a folder. It adds its words to ssh.txt, and serves the files of this machine; the
/// folder is the home folder.
inline void write_ssh(const TempFolder& folder) {
  const std::string program = folder.write(
      "bin/ssh", fmt::format("#!/bin/sh\necho \"$@\" >> {0}ssh.txt\nexec {1} -d {0}\n", folder.path(), sftp_server));
  std::filesystem::permissions(program, std::filesystem::perms::owner_all);
}

}  // namespace splatvol::test
