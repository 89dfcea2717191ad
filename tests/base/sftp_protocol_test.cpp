#include "base/sftp_protocol.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "tests/support/results.h"
#include "tests/support/sftp_answers.h"

namespace splatvol::test {
namespace {

using namespace ::testing;
using namespace std::string_literals;

constexpr std::size_t most_read = most_sftp_read_bytes;

std::span<const std::byte> bytes_of(std::string_view text) { return std::as_bytes(std::span(text)); }

std::string text_of_bytes(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// A packet in front of whose bytes stands no length.
Result<SftpAnswer> parsed(const std::string& packet) {
  static std::string kept;
  kept = packet.substr(4);
  return parse_sftp_answer(bytes_of(kept));
}

TEST(SftpPackets, AreThoseOfTheDraft) {
  EXPECT_EQ(sftp_init(), "\0\0\0\5\1\0\0\0\3"s);
  EXPECT_EQ(sftp_open(1, "/a"), "\0\0\0\x13\3\0\0\0\1\0\0\0\2/a\0\0\0\1\0\0\0\0"s);
  EXPECT_EQ(sftp_fstat(2, "h"), "\0\0\0\n\10\0\0\0\2\0\0\0\1h"s);
  EXPECT_EQ(sftp_read(0x01020304, "h", 0x1122334455667788, 300),
            "\0\0\0\x16\5\1\2\3\4\0\0\0\1h\x11\x22\x33\x44\x55\x66\x77\x88\0\0\1\x2c"s);
}

TEST(SftpAnswer, HasItsFields) {
  EXPECT_EQ(std::get<SftpVersion>(value_of(parsed(version_answer(3)))).version, 3u);
  EXPECT_EQ(std::get<SftpVersion>(value_of(parsed(sftp_packet(2, 3, sftp_text("a@b") + sftp_text("1"))))).version, 3u);
  const auto status = std::get<SftpStatus>(value_of(parsed(status_answer(7, 4, "Failure"))));
  EXPECT_EQ(status.id, 7u);
  EXPECT_EQ(text_of(status), "the server answers 4: Failure");
  const auto bare = std::get<SftpStatus>(value_of(parsed(sftp_packet(101, 7, sftp_number(2)))));
  EXPECT_EQ(text_of(bare), "not found") << "servers of version 2 send no message";
  EXPECT_EQ(std::get<SftpHandle>(value_of(parsed(handle_answer(7, "a\0b"s)))).handle, "a\0b"s);
  EXPECT_EQ(text_of_bytes(std::get<SftpData>(value_of(parsed(data_answer(7, "abc")))).bytes), "abc");
  const auto all = std::get<SftpAttributes>(value_of(parsed(attributes_answer(7, 1ull << 40, 0100600, 5))));
  EXPECT_EQ(all.size, 1ull << 40);
  EXPECT_EQ(all.permissions, 0100600u);
  EXPECT_EQ(all.changed, 5u);
  const auto none = std::get<SftpAttributes>(value_of(parsed(sftp_packet(105, 7, sftp_number(0)))));
  EXPECT_FALSE(none.size || none.permissions || none.changed);
}

TEST(SftpAnswer, ThatIsCutAnywhereIsRefused) {
  for (const std::string& whole :
       {version_answer(), handle_answer(7, "handle"), data_answer(7, "bytes"), attributes_answer(7, 1000)}) {
    const std::string packet = whole.substr(4);
    for (std::size_t bytes = 0; bytes < packet.size(); ++bytes) {
      const std::vector<char> exact(packet.begin(), packet.begin() + static_cast<std::ptrdiff_t>(bytes));
      EXPECT_THAT(parse_sftp_answer(std::as_bytes(std::span(exact))), FailsWith(ErrorCode::invalid_data)) << bytes;
    }
  }
  EXPECT_THAT(parsed(sftp_packet(101, 7, "")), FailsWith(ErrorCode::invalid_data, HasSubstr("ends too soon")));
  EXPECT_THAT(parsed(sftp_packet(101, 7, sftp_number(2) + "x")), FailsWith(ErrorCode::invalid_data));
  EXPECT_THAT(parsed(sftp_packet(104, 7)), FailsWith(ErrorCode::invalid_data, HasSubstr("type 104")));
  EXPECT_THAT(parsed(handle_answer(7, std::string(257, 'h'))), FailsWith(ErrorCode::invalid_data, HasSubstr("handle")));
}

TEST(SftpAnswers, ComeWhereverTheStreamIsCut) {
  const std::string stream = version_answer() + data_answer(1, "abc") + status_answer(2, 1);
  for (const std::size_t step : {std::size_t{1}, std::size_t{3}, stream.size()}) {
    SftpAnswers answers;
    std::vector<std::size_t> kinds;
    for (std::size_t at = 0; at < stream.size(); at += step) {
      answers.add(bytes_of(std::string_view(stream).substr(at, step)));
      for (auto next = value_of(answers.next()); next; next = value_of(answers.next())) kinds.push_back(next->index());
    }
    EXPECT_THAT(kinds, ElementsAre(0, 3, 1)) << step;
  }
}

TEST(SftpAnswers, OfALengthThatNobodyAskedForAreRefusedAtOnce) {
  const auto refusal = [](const std::string& begin) {
    SftpAnswers answers;
    answers.add(bytes_of(begin));
    return message_of(answers.next());
  };
  EXPECT_THAT(refusal(sftp_number(34001)), HasSubstr("a packet of 34001 bytes"));
  EXPECT_THAT(refusal(sftp_number(0xffffffff)), HasSubstr("a packet of 4294967295 bytes"));
  EXPECT_THAT(refusal("Welcome"), HasSubstr("a text in place of SFTP"));
  EXPECT_THAT(refusal(sftp_number(0)), HasSubstr("a packet of type 0"));
  EXPECT_EQ(refusal(sftp_number(34000)), "");
}

// Reads of a file of numbered bytes, with an id for each.
struct SftpReadsTest : Test {
  static char byte_at(std::uint64_t offset) { return static_cast<char>(offset * 7 >> 3); }

  // An answer of the bytes at an offset.
  static SftpAnswer data(std::uint32_t id, std::uint64_t offset, std::size_t bytes) {
    static std::string text;
    text.clear();
    for (std::uint64_t i = offset; i < offset + bytes; ++i) text += byte_at(i);
    return SftpData{id, bytes_of(text)};
  }

  void add(std::uint64_t offset, std::size_t bytes) {
    out_.assign(bytes, '?');
    reads_.add(offset, std::as_writable_bytes(std::span(out_)), group_);
  }

  void expect_bytes(std::uint64_t offset) const {
    EXPECT_EQ(group_.left, 0u);
    EXPECT_FALSE(group_.failure);
    for (std::size_t i = 0; i < out_.size(); ++i) ASSERT_EQ(out_[i], byte_at(offset + i)) << i;
  }

  SftpReads reads_;
  SftpReads::Group group_;
  std::string out_;
};

TEST_F(SftpReadsTest, AreAtMost32OnTheirWayAndEndInAnyOrder) {
  add(1000, 40 * most_read + 5);
  EXPECT_EQ(group_.left, 41u);
  std::string expected;
  for (std::uint32_t i = 0; i < 32; ++i) expected += sftp_read(i + 1, "h", 1000 + i * most_read, most_read);
  EXPECT_EQ(reads_.take_packets("h"), expected);
  EXPECT_EQ(reads_.take_packets("h"), "");
  for (std::uint32_t id = 32; id > 0; --id)
    EXPECT_TRUE(value_of(reads_.take(data(id, 1000 + (id - 1) * most_read, most_read))));
  EXPECT_EQ(reads_.take_packets("h").size(), 9 * sftp_read(0, "h", 0, 0).size());
  for (const std::uint32_t id : {41u, 33u, 40u, 34u, 39u, 35u, 38u, 36u, 37u})
    EXPECT_TRUE(value_of(reads_.take(data(id, 1000 + (id - 1) * most_read, id == 41 ? 5 : most_read))));
  EXPECT_FALSE(reads_.are_awaited());
  expect_bytes(1000);
}

TEST_F(SftpReadsTest, GoOnBehindShortAnswers) {
  add(50, 10);
  EXPECT_EQ(reads_.take_packets("h"), sftp_read(1, "h", 50, 10));
  EXPECT_FALSE(value_of(reads_.take(data(1, 50, 4))));
  EXPECT_EQ(reads_.take_packets("h"), sftp_read(2, "h", 54, 6));
  EXPECT_FALSE(value_of(reads_.take(data(2, 54, 5))));
  EXPECT_EQ(reads_.take_packets("h"), sftp_read(3, "h", 59, 1));
  EXPECT_TRUE(value_of(reads_.take(data(3, 59, 1))));
  expect_bytes(50);
}

TEST_F(SftpReadsTest, RefuseAnswersThatNobodyAskedFor) {
  add(0, 10);
  EXPECT_THAT(reads_.take(data(1, 0, 10)), FailsWith(ErrorCode::invalid_data, HasSubstr("nobody asked")));
  EXPECT_NE(reads_.take_packets("h"), "");
  EXPECT_THAT(reads_.take(data(2, 0, 10)), FailsWith(ErrorCode::invalid_data, HasSubstr("nobody asked")));
  EXPECT_THAT(reads_.take(data(1, 0, 0)), FailsWith(ErrorCode::invalid_data, HasSubstr("without bytes")));
  EXPECT_THAT(reads_.take(data(1, 0, 11)), FailsWith(ErrorCode::invalid_data, HasSubstr("more bytes")));
  EXPECT_THAT(reads_.take(SftpHandle{1, "h"}), FailsWith(ErrorCode::invalid_data, HasSubstr("something else")));
  EXPECT_EQ(out_, std::string(10, '?'));
  EXPECT_TRUE(value_of(reads_.take(data(1, 0, 10))));
  EXPECT_THAT(reads_.take(data(1, 0, 10)), FailsWith(ErrorCode::invalid_data)) << "a second time";
}

TEST_F(SftpReadsTest, ThatAreRefusedFailTheirGroupAlone) {
  SftpReads::Group other;
  std::string others(8, '?');
  add(0, 2 * most_read);
  reads_.add(3, std::as_writable_bytes(std::span(others)), other);
  EXPECT_NE(reads_.take_packets("h"), "");
  EXPECT_TRUE(value_of(reads_.take(SftpStatus{1, 1, ""})));
  EXPECT_EQ(group_.left, 0u);
  EXPECT_THAT(group_.failure->message, HasSubstr("became shorter"));
  EXPECT_TRUE(value_of(reads_.take(data(2, most_read, most_read)))) << "it was on its way";
  EXPECT_EQ(out_, std::string(2 * most_read, '?'));
  EXPECT_TRUE(value_of(reads_.take(data(3, 3, 8))));
  EXPECT_EQ(other.left, 0u);
  EXPECT_FALSE(other.failure);
}

TEST_F(SftpReadsTest, ThatAreForgottenLeaveTheirBytesAlone) {
  add(0, 40 * most_read);
  EXPECT_NE(reads_.take_packets("h"), "");
  reads_.forget(group_);
  EXPECT_EQ(group_.left, 0u);
  EXPECT_TRUE(reads_.are_awaited());
  EXPECT_TRUE(value_of(reads_.take(data(1, 0, most_read))));
  EXPECT_THAT(reads_.take(data(2, 0, most_read + 1)), FailsWith(ErrorCode::invalid_data));
  EXPECT_EQ(out_, std::string(40 * most_read, '?'));
  EXPECT_EQ(reads_.take_packets("h"), "");
}

TEST_F(SftpReadsTest, AreAskedForOnceMoreWhenAConnectionIsLost) {
  add(0, 3 * most_read);
  EXPECT_NE(reads_.take_packets("h"), "");
  EXPECT_TRUE(value_of(reads_.take(data(2, most_read, most_read))));
  const Error lost{ErrorCode::io, "lost"};
  reads_.lose_answers(lost);
  EXPECT_FALSE(reads_.are_awaited());
  EXPECT_EQ(reads_.take_packets("i"), sftp_read(4, "i", 0, most_read) + sftp_read(5, "i", 2 * most_read, most_read));
  EXPECT_TRUE(value_of(reads_.take(data(4, 0, most_read))));
  reads_.lose_answers(lost);
  EXPECT_EQ(group_.left, 0u);
  EXPECT_EQ(group_.failure->message, "lost");
  EXPECT_EQ(reads_.take_packets("h"), "");
}

}  // namespace
}  // namespace splatvol::test
