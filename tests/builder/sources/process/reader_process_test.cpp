#include "builder/sources/process/reader_process.h"

#include <gmock/gmock.h>
#include <sys/wait.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>

#include "builder/opening/open_source.h"
#include "builder/sources/process/serve_sources.h"
#include "tests/builder/sources/read_input.h"
#include "tests/builder/sources/vtk_text.h"
#include "tests/support/results.h"
#include "tests/support/sanitizers.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

struct ReaderProcessTest : FolderTest {
  /// A tetrahedron with an attribute of numbers.
  std::string sound_mesh() const { return write("sound.vtu", tetrahedron_at(0).file()); }

  static std::string error_of(const ReaderProcessOptions& options, const std::string& input) {
    ReaderProcess reader(options);
    const auto source = reader.open({input}, {});
    return source ? "(no error)" : source.error().message;
  }

  std::string program(const std::string& script) const {
    const std::string file = write("reader.sh", "#!/bin/bash\n" + script);
    std::filesystem::permissions(file, std::filesystem::perms::owner_all);
    return file;
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
      write("hostile.vtu", tetrahedron_at(0, {{"s", {1, 2, 3, 4}, 1, "String"}, {"f", {1, 2, 3, 4}}}).file());
  ReaderProcess reader(reader_options());
  EXPECT_THAT(message_of(reader.open({hostile}, {})),
              AllOf(StartsWith(hostile), HasSubstr(is_sanitized ? "ended" : "crashes")));
  const auto source = value_of(reader.open({sound_mesh()}, {}));
  EXPECT_EQ(source->next().value()->points.size(), 4u);
}

TEST_F(ReaderProcessTest, MemoryIsLimited) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers reserve more memory than any limit";
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
    ReaderProcessOptions options = options_with(program(script));
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
  ReaderProcessOptions options = options_with(program("exec sleep 60"));
  options.patience = std::chrono::seconds(60);
  options.factor = 1e-3;
  EXPECT_THAT(error_of(options, path("large.vtu")), HasSubstr("longer than 1.6 s"));
}

// More than the kernel holds for a socket.
TEST_F(ReaderProcessTest, AReaderThatDoesNotTakeWhatIsSentIsEnded) {
  ReaderProcess reader(options_with(program("exec sleep 60")));
  EXPECT_THAT(message_of(reader.open(std::vector<std::string>(1000, std::string(10'000, 'x')), {})),
              HasSubstr("for 2 s"));
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

// VTK opens some of them by itself, and our own readers ask the system not to wait.
TEST_F(ReaderProcessTest, TellsOfAllFilesThatWereOpened) {
  const std::string mesh = sound_mesh(), collection = write("all.pvd",
                                                            "<VTKFile type=\"Collection\"><Collection>"
                                                            "<DataSet timestep=\"0\" file=\"sound.vtu\"/>"
                                                            "</Collection></VTKFile>");
  ReaderProcess reader(reader_options());
  auto source = value_of(reader.open({collection}, {}));
  while (value_of(source->next())) {
  }
  EXPECT_THAT(reader.files().opened, IsSupersetOf({collection, mesh}));
  EXPECT_TRUE(reader.files().are_all);
  EXPECT_FALSE(reader.open({path("none.vtu")}, {}));
  source = value_of(reader.open({mesh}, {}));
  EXPECT_THAT(reader.files().missing, Contains(path("none.vtu")));
}

TEST_F(ReaderProcessTest, TellsHowMuchWasRead) {
  std::vector<double> shares;
  ReaderProcessOptions options = reader_options();
  options.progress = [&](double share) { shares.push_back(share); };
  ReaderProcess reader(options);
  auto source = value_of(reader.open({sound_mesh()}, {}));
  while (value_of(source->next())) {
  }
  ASSERT_FALSE(shares.empty());
  EXPECT_TRUE(std::ranges::is_sorted(shares));
  EXPECT_GE(shares.front(), 0);
  EXPECT_LE(shares.back(), 1);
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
  const auto source = value_of(reader.open({sound_mesh()}, {}));
  const auto mesh = value_of(reader.read_surface(surface));
  EXPECT_EQ(mesh.points.size(), 4u);
  EXPECT_EQ(mesh.triangles.size(), 2u);
  EXPECT_THAT(reader.read_surface(path("none.obj")).error().message, StartsWith(path("none.obj")));
  EXPECT_EQ(source->next().value()->points.size(), 4u);
}

}  // namespace
}  // namespace splatvol::test
