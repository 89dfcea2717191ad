// Reads of a source against the text that it has.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
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

/// Expects of each range of up to 3 bytes near some offsets that it is read if it is in the file, and else refused.
inline void expect_ranges_near(std::initializer_list<std::size_t> offsets, ByteSource& source,
                               const std::string& text) {
  for (const std::size_t near : offsets)
    for (std::size_t offset = near - 2; offset <= near + 2; ++offset)
      for (std::size_t count = 0; count <= 3; ++count) {
        std::string out(count, '?');
        const Status status = read_at(source, offset, out);
        EXPECT_EQ(status.has_value(), offset + count <= text.size()) << offset << '+' << count;
        if (status)
          EXPECT_EQ(out, text.substr(offset, count));
        else
          EXPECT_EQ(status.error().code, ErrorCode::invalid_data);
      }
  std::array<std::byte, 8> out{};
  constexpr auto largest = std::numeric_limits<std::uint64_t>::max();
  for (const std::uint64_t offset : {largest, largest - 7, largest - 8}) EXPECT_FALSE(source.read(offset, out));
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
