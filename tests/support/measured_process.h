// Runs the programs of this project in tests, and measures their memory.
#pragma once

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

namespace splatvol::test {

inline constexpr std::uint64_t mebibyte = 1u << 20;

struct Measured {
  int code = -1;               // -1 if a signal ended the process
  std::uint64_t peak_rss = 0;  // bytes; at least those of the process that started it
  std::string errors = {};     // what it wrote to the standard error
};

/// Runs a program, by its name or path. `address_space`: its limit in bytes; 0: none.
inline Measured run_measured(std::vector<std::string> words, std::uint64_t address_space = 0) {
  if (!words[0].starts_with('/')) words[0] = SPLATVOL_BIN "/" + words[0];
  const std::unique_ptr<FILE, int (*)(FILE*)> errors(std::tmpfile(), std::fclose);
  const pid_t child = ::fork();
  if (child == 0) {
    const int null = ::open("/dev/null", O_RDWR);
    for (const int stream : {0, 1}) ::dup2(null, stream);
    ::dup2(::fileno(errors.get()), 2);
    const rlimit limit{address_space, address_space};
    if (address_space > 0) ::setrlimit(RLIMIT_AS, &limit);
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    ::execv(arguments[0], arguments.data());
    ::_exit(127);
  }
  int status = 0;
  rusage usage{};
  ::wait4(child, &status, 0, &usage);
  Measured measured{WIFEXITED(status) ? WEXITSTATUS(status) : -1, static_cast<std::uint64_t>(usage.ru_maxrss) * 1024};
  std::rewind(errors.get());
  for (int c = 0; (c = std::fgetc(errors.get())) != EOF;) measured.errors.push_back(static_cast<char>(c));
  return measured;
}

}  // namespace splatvol::test
