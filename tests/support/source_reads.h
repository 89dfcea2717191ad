// Reads of a source against the text that it has.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "base/file.h"

namespace splatvol::test {

inline std::string random_text(std::size_t bytes, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::string text(bytes, '\0');
  for (char& c : text) c = static_cast<char>(random());
  return text;
}

inline Status read_at(ByteSource& source, std::uint64_t offset, std::string& out) {
  return source.read(offset, std::as_writable_bytes(std::span(out)));
}

/// Reads random ranges on some threads. Returns what was wrong in each; empty: nothing.
inline std::vector<std::string> mistakes_of_threads(ByteSource& source, const std::string& text) {
  constexpr std::uint32_t thread_count = 6;
  std::vector<std::string> mistakes(thread_count);
  std::vector<std::thread> threads;
  for (std::uint32_t t = 0; t < thread_count; ++t)
    threads.emplace_back([&, t] {
      std::mt19937 random(t);
      for (int i = 0; i < 50; ++i) {
        const std::size_t offset = random() % (text.size() + 1);
        std::string out(random() % (text.size() - offset + 1), '?');
        if (const Status status = read_at(source, offset, out); !status) mistakes[t] = status.error().message;
        if (out != text.substr(offset, out.size())) mistakes[t] += " other bytes";
      }
    });
  for (std::thread& thread : threads) thread.join();
  return mistakes;
}

}  // namespace splatvol::test
