#include "builder/sources/process/reader_process.h"

#include <gmock/gmock.h>
#include <malloc.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <thread>

#include "builder/open_source.h"
#include "builder/sources/process/held_values.h"
#include "builder/sources/process/messages.h"
#include "builder/sources/process/serve_sources.h"
#include "tests/builder/sources/folder_test.h"
#include "tests/builder/sources/read_input.h"
#include "tests/support/sanitizers.h"

namespace splatvol {
namespace {

using test::reader_options;
using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

constexpr std::uint64_t plenty = std::uint64_t{1} << 30;

class ReaderProcessTest : public test::FolderTest {
 protected:
  /// A tetrahedron with an attribute of numbers, and more arrays at its points.
  std::string mesh(const std::string& name, const std::string& more = "") const {
    return write(name,
                 "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\"><UnstructuredGrid><Piece NumberOfPoints=\"4\" "
                 "NumberOfCells=\"1\"><PointData>" +
                     more +
                     "<DataArray type=\"Float32\" Name=\"f\" format=\"ascii\">1 2 3 4</DataArray></PointData>"
                     "<Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 1 0 0 0 1 0 "
                     "0 0 1</DataArray></Points><Cells><DataArray type=\"Int32\" Name=\"connectivity\" "
                     "format=\"ascii\">0 1 2 3</DataArray><DataArray type=\"Int32\" Name=\"offsets\" "
                     "format=\"ascii\">4</DataArray><DataArray type=\"UInt8\" Name=\"types\" "
                     "format=\"ascii\">10</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>");
  }
  std::string sound_mesh() const { return mesh("sound.vtu"); }

  static std::string error_of(const ReaderProcessOptions& options, const std::string& input) {
    ReaderProcess reader(options);
    const auto source = reader.open({input}, {});
    return source ? "(no error)" : source.error().message;
  }

  std::string sleeping_program() const {
    const std::string program = write("reader.sh", "#!/bin/bash\nexec sleep 60");
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    return program;
  }

  static ReaderProcessOptions options_with(const std::string& program) {
    ReaderProcessOptions options = reader_options();
    options.program = program;
    options.patience = std::chrono::seconds(2);
    return options;
  }
};

TEST_F(ReaderProcessTest, ACrashIsOneLineAndTheNextFileIsRead) {
  // VTK 9.1 follows a null pointer for texts without their ends.
  const std::string hostile =
      mesh("hostile.vtu", "<DataArray type=\"String\" Name=\"s\" format=\"ascii\">1 2 3 4</DataArray>");
  ReaderProcess reader(reader_options());
  const auto refused = reader.open({hostile}, {});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, AllOf(StartsWith(hostile), HasSubstr(test::is_sanitized ? "ended" : "crashes")));
  const auto source = reader.open({sound_mesh()}, {});
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->next().value()->points.size(), 4u);
}

TEST_F(ReaderProcessTest, MemoryIsLimited) {
  if (test::is_sanitized) GTEST_SKIP() << "sanitizers reserve more memory than any limit";
  ReaderProcessOptions options = reader_options();
  options.memory = 1u << 20;
  EXPECT_THAT(error_of(options, sound_mesh()), HasSubstr("memory"));
}

TEST_F(ReaderProcessTest, AReaderThatDoesNotGetOnIsEnded) {
  EXPECT_THAT(error_of(options_with("/bin/sleep"), sound_mesh()), HasSubstr("for 2 s"));
  EXPECT_THAT(error_of(options_with("/bin/false"), sound_mesh()), HasSubstr("ended too early"));
  EXPECT_THAT(error_of(options_with(path("none")), sound_mesh()),
              AllOf(HasSubstr("cannot start"), HasSubstr(path("none"))));
}

// Programs in place of the reader, with a small share of what it may read and how long it may take.
TEST_F(ReaderProcessTest, AReaderThatReadsOrTakesTooMuchIsEnded) {
  const auto error_of_script = [&](const std::string& script, double factor, int patience) {
    const std::string program = write("reader.sh", "#!/bin/bash\n" + script);
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    ReaderProcessOptions options = options_with(program);
    options.factor = factor;
    options.patience = std::chrono::seconds(patience);
    return error_of(options, sound_mesh());
  };
  EXPECT_THAT(error_of_script("exec cat /dev/zero > /dev/null", 1e-3, 60),
              AllOf(StartsWith(path("sound.vtu") + ": more than 1.07 MB were read for it"),
                    HasSubstr("'--read-factor 0.004'")));
  EXPECT_THAT(error_of_script("exec sleep 60", 1e-3, 60),
              AllOf(StartsWith(path("sound.vtu") + ": reading it takes longer than 0.6 s"),
                    HasSubstr("'--read-factor 0.004'")));
  // A refusal of 4096 characters, of which one comes now and then.
  EXPECT_THAT(error_of_script("printf '\\1\\0\\0\\0\\0\\0\\x10\\0\\0\\0\\0\\0\\0' >&3\n"
                              "while printf x >&3; do sleep 0.1; done",
                              5e-3, 2),
              HasSubstr("longer than 3 s"));
}

// A large input may be read for longer.
TEST_F(ReaderProcessTest, WhatIsAllowedGrowsWithTheInput) {
  std::ofstream(path("large.vtu")).close();
  std::filesystem::resize_file(path("large.vtu"), 1'000'000'000);
  ReaderProcessOptions options = options_with(sleeping_program());
  options.patience = std::chrono::seconds(60);
  options.factor = 1e-3;
  EXPECT_THAT(error_of(options, path("large.vtu")), HasSubstr("longer than 1.6 s"));
}

// More than the kernel holds for a socket.
TEST_F(ReaderProcessTest, AReaderThatDoesNotTakeWhatIsSentIsEnded) {
  ReaderProcess reader(options_with(sleeping_program()));
  const auto source = reader.open(std::vector<std::string>(1000, std::string(10'000, 'x')), {});
  ASSERT_FALSE(source);
  EXPECT_THAT(source.error().message, HasSubstr("for 2 s"));
}

TEST_F(ReaderProcessTest, NoProcessIsLeft) {
  {
    ReaderProcess reader(reader_options());
    EXPECT_TRUE(reader.open({sound_mesh()}, {}));
  }
  (void)error_of(options_with("/bin/sleep"), sound_mesh());
  EXPECT_EQ(::waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
}

TEST_F(ReaderProcessTest, SourcesOutliveTheReaderAndItsOtherSources) {
  std::unique_ptr<Source> second;
  {
    ReaderProcess reader(reader_options());
    const auto first = reader.open({sound_mesh()}, {}).value();
    second = reader.open({sound_mesh()}, {}).value();
  }
  EXPECT_EQ(second->next().value()->points.size(), 4u);
  EXPECT_EQ(second->next().value(), nullptr);
}

TEST_F(ReaderProcessTest, SurfacesAndSourcesShareAProcess) {
  const std::string surface = write("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
  ReaderProcess reader(reader_options());
  const auto source = reader.open({sound_mesh()}, {});
  ASSERT_TRUE(source) << source.error().message;
  const auto mesh = reader.read_surface(surface);
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(mesh->points.size(), 4u);
  EXPECT_EQ(mesh->triangles.size(), 2u);
  EXPECT_THAT(reader.read_surface(path("none.obj")).error().message, StartsWith(path("none.obj")));
  EXPECT_EQ((*source)->next().value()->points.size(), 4u);
}

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
  const auto received = sent(piece);
  ASSERT_TRUE(received) << received.error().message;
  EXPECT_EQ(received->points, piece.points);
  EXPECT_EQ(received->tetrahedra, piece.tetrahedra);
  EXPECT_EQ(received->values[0][3], 4);
  EXPECT_TRUE(std::isnan(received->values[0][2]));
  EXPECT_EQ(received->fills, piece.fills);
  EXPECT_EQ(received->census.cells, piece.census.cells);
  EXPECT_EQ(received->census.not_star_shaped, 9u);
  EXPECT_EQ(received->material->moments[2].mass, 3);
  EXPECT_EQ(received->material->planes[3].offset, -1);
  EXPECT_EQ(received->cells->points, piece.cells->points);
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
    const auto received = sent(std::move(piece));
    ASSERT_TRUE(received) << received.error().message;
    std::vector<double> got(4);
    received->lent->get(0, std::vector<std::uint32_t>{0, 1, 2, 3}, got);
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
  if (test::is_sanitized) GTEST_SKIP() << "sanitizers have an allocator of their own";
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
}  // namespace splatvol
