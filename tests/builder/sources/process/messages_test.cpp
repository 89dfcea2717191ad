// What the reader's process and the programs say to each other, in one process.
#include "builder/sources/process/messages.h"

#include <gmock/gmock.h>
#include <malloc.h>
#include <sys/socket.h>

#include <array>
#include <cmath>
#include <numeric>
#include <thread>

#include "builder/sources/process/held_values.h"
#include "tests/support/results.h"
#include "tests/support/sanitizers.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

constexpr std::uint64_t plenty = std::uint64_t{1} << 30;

/// Both ends of a socket in one process. What is sent waits in the kernel.
struct Ends {
  explicit Ends(std::uint64_t most_bytes) : sockets(make()), from(sockets[0], plenty), to(sockets[1], most_bytes) {}
  static std::array<int, 2> make() {
    std::array<int, 2> sockets{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets.data()), 0);
    return sockets;
  }
  std::array<int, 2> sockets;
  Channel from, to;
};

/// Sends a piece of one attribute, and receives it.
Result<Piece> sent(Piece piece) {
  Ends ends(plenty);
  SPLATVOL_TRY(put(ends.from, std::make_unique<Piece>(std::move(piece)), 1));
  SPLATVOL_TRY(ends.from.flush());
  Piece received;
  SPLATVOL_TRY(get(ends.to, received, 1));
  return received;
}

Piece tetrahedron() {
  Piece piece;
  piece.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  piece.values = {{1, 2, missing_value, 4}};
  piece.tetrahedra = {{0, 1, 2, 3}};
  return piece;
}

TEST(ReaderMessages, KeepEveryPartOfAPiece) {
  Piece piece = tetrahedron();
  piece.block = 0x123456789abcdef0;
  piece.fills = {7};
  piece.census.cells["wedge"] = 5;
  piece.census.not_star_shaped = 9;
  piece.material.emplace();
  piece.material->moments.resize(4);
  piece.material->moments[2].mass = 3;
  piece.material->value_moments.assign(1, std::vector<ValueMoments>(4));
  piece.material->planes.resize(4);
  piece.material->planes[3].offset = -1;
  piece.cells.emplace();
  piece.cells->corners = piece.points;
  piece.cells->tetrahedra = {{3, 2, 1, 0}};
  piece.cells->points = {PointCells::no_point};
  piece.cells->moments.resize(4);
  const auto received = value_of(sent(piece));
  EXPECT_EQ(received.block, piece.block);
  EXPECT_EQ(received.points, piece.points);
  EXPECT_EQ(received.tetrahedra, piece.tetrahedra);
  EXPECT_EQ(received.values[0][3], 4);
  EXPECT_TRUE(std::isnan(received.values[0][2]));
  EXPECT_EQ(received.fills, piece.fills);
  EXPECT_EQ(received.census.cells, piece.census.cells);
  EXPECT_EQ(received.census.not_star_shaped, 9u);
  EXPECT_EQ(received.material->moments[2].mass, 3);
  EXPECT_EQ(received.material->planes[3].offset, -1);
  EXPECT_EQ(received.cells->points, piece.cells->points);
}

TEST(ReaderMessages, SurfacesThatContradictThemselvesAreRefused) {
  const auto sent_surface = [](const TriangleMesh& mesh) -> Result<TriangleMesh> {
    Ends ends(plenty);
    SPLATVOL_TRY(put(ends.from, mesh));
    SPLATVOL_TRY(ends.from.flush());
    TriangleMesh received;
    SPLATVOL_TRY(get(ends.to, received));
    return received;
  };
  const TriangleMesh sound{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}};
  EXPECT_EQ(sent_surface(sound)->points, sound.points);
  EXPECT_EQ(sent_surface(sound)->triangles, sound.triangles);
  TriangleMesh beyond = sound;
  beyond.triangles[0][1] = 3;
  EXPECT_FALSE(sent_surface(beyond));
  for (const double number : {std::nan(""), HUGE_VAL, 1e51}) {
    TriangleMesh odd = sound;
    odd.points[2].y = number;
    EXPECT_FALSE(sent_surface(odd)) << number;
  }
}

TEST(ReaderMessages, LentValuesKeepEveryDigit) {
  for (const double number : {0.5, 0.1, 1e300, -1e-300, std::nextafter(1.0, 2.0)}) {
    Piece piece = tetrahedron();
    piece.values.clear();
    const std::vector<double> values = {number, 2, missing_value, -0.0};
    piece.lent = std::make_shared<HeldValues>(std::vector<PackedColumn>{pack_column(values)});
    const auto received = value_of(sent(std::move(piece)));
    std::vector<double> got(4);
    received.lent->get(0, std::vector<std::uint32_t>{0, 1, 2, 3}, got);
    EXPECT_EQ(got[0], number);
    EXPECT_TRUE(std::isnan(got[2]));
    EXPECT_TRUE(std::signbit(got[3]));
  }
  EXPECT_EQ(pack_column(std::vector<double>{0.5, missing_value}).index(), 0u) << "single precision";
}

TEST(ReaderMessages, PiecesThatContradictThemselvesAreRefused) {
  Piece piece = tetrahedron();
  piece.tetrahedra = {{0, 1, 2, 4}};
  EXPECT_THAT(sent(piece).error().message, HasSubstr("tetrahedra"));
  piece = tetrahedron();
  piece.values[0].pop_back();
  EXPECT_THAT(sent(piece).error().message, HasSubstr("values"));
  piece = tetrahedron();
  piece.values.emplace_back(4);
  EXPECT_THAT(sent(piece).error().message, HasSubstr("values"));
  piece = tetrahedron();
  piece.fills = {1, 2};
  EXPECT_THAT(sent(piece).error().message, HasSubstr("counts"));
  piece = tetrahedron();
  piece.material.emplace();
  EXPECT_THAT(sent(piece).error().message, HasSubstr("material"));
  piece = tetrahedron();
  piece.cells.emplace();
  piece.cells->moments.resize(4);
  piece.cells->tetrahedra = {{0, 0, 0, 0}};
  piece.cells->points = {0};
  EXPECT_THAT(sent(piece).error().message, HasSubstr("cells"));
}

TEST(ReaderMessages, ErrorsAreOneShortLine) {
  const auto sent_error = [](const Error& error) {
    Ends ends(plenty);
    EXPECT_TRUE(put(ends.from, error));
    EXPECT_TRUE(ends.from.flush());
    Error received{};
    EXPECT_TRUE(get(ends.to, received));
    return received;
  };
  EXPECT_EQ(sent_error({ErrorCode::io, "a.vtu: \x1b[2Jgone\n\r\x07"}).message, "a.vtu: ?[2Jgone???");
  EXPECT_EQ(sent_error({ErrorCode::io, std::string(4096, 'x')}).message, std::string(4096, 'x'));
  EXPECT_EQ(sent_error({ErrorCode::unsupported, std::string(100'000, 'x')}).message, std::string(4093, 'x') + "...");
  EXPECT_EQ(sent_error({ErrorCode::unsupported, "x"}).code, ErrorCode::unsupported);
  SourceState state, received;
  state.conversions = {"a\nb", std::string(100'000, 'x')};
  Ends ends(plenty);
  ASSERT_TRUE(put(ends.from, state));
  ASSERT_TRUE(ends.from.flush());
  ASSERT_TRUE(get(ends.to, received));
  EXPECT_EQ(received.conversions[0], "a?b");
  EXPECT_EQ(received.conversions[1].size(), 4096u);
}

// As a reader sends them that a file has taken over.
TEST(ReaderMessages, ErrorsThatAreNoneAreRefused) {
  const auto is_refused = [](ErrorCode code, std::uint64_t bytes) {
    Ends ends(plenty);
    EXPECT_TRUE(ends.from.put(code));
    EXPECT_TRUE(ends.from.put(std::string(bytes, 'x')));
    EXPECT_TRUE(ends.from.flush());
    Error error{};
    return !get(ends.to, error);
  };
  EXPECT_FALSE(is_refused(ErrorCode::cancelled, 4096));
  EXPECT_TRUE(is_refused(ErrorCode::io, 4097));
  EXPECT_TRUE(is_refused(static_cast<ErrorCode>(7), 10));
}

/// Bytes in large blocks of memory, which the C library asks of the system one by one.
std::size_t large_blocks() { return ::mallinfo2().hblkhd; }

// A count alone takes no memory, whatever it counts.
TEST(ReaderMessages, ArraysGrowWithWhatArrives) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers have an allocator of their own";
  const auto held_after_a_count = [](auto values) {
    Ends ends(plenty);
    EXPECT_TRUE(ends.from.put(plenty / 64));
    EXPECT_TRUE(ends.from.put(std::array<std::uint64_t, 8>{}));
    EXPECT_TRUE(ends.from.flush());
    ::shutdown(ends.sockets[0], SHUT_WR);
    const std::size_t before = large_blocks();
    EXPECT_FALSE(ends.to.get(values));
    return large_blocks() - before;
  };
  EXPECT_LT(held_after_a_count(std::vector<double>()), std::size_t{1} << 20);
  EXPECT_LT(held_after_a_count(std::string()), std::size_t{1} << 20);
  EXPECT_LT(held_after_a_count(std::vector<std::string>()), std::size_t{1} << 20);
  EXPECT_LT(held_after_a_count(std::vector<std::vector<double>>()), std::size_t{1} << 20);
}

TEST(ReaderMessages, ArraysOfEverySizeArriveWhole) {
  for (const std::size_t size : {0u, 1u, 8192u, 8193u, 8194u, 32'771u, 300'000u}) {
    Ends ends(plenty);
    std::vector<double> values(size), received(3, 7.0);
    std::iota(values.begin(), values.end(), 1.0);
    std::thread sender([&] { EXPECT_TRUE(ends.from.put(values) && ends.from.flush()); });
    EXPECT_TRUE(ends.to.get(received));
    sender.join();
    EXPECT_EQ(received, values) << size;
  }
}

TEST(ReaderMessages, ArraysBeyondTheLimitAreRefused) {
  Ends ends(1000);
  ASSERT_TRUE(ends.from.put(std::uint64_t{1} << 60));
  ASSERT_TRUE(ends.from.flush());
  std::vector<double> values;
  EXPECT_THAT(ends.to.get(values).error().message, HasSubstr("1000 may be held"));
}

}  // namespace
}  // namespace splatvol::test
