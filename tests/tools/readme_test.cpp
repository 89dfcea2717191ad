// The commands of README.md, as a user would copy them: each works, and none changes a file that was there.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <sstream>
#include <vector>

#include "base/file.h"
#include "tests/support/loopback.h"
#include "tests/support/nginx.h"
#include "tests/support/openfoam_files.h"
#include "tests/support/programs.h"
#include "tests/support/sftp_server.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using Files = std::map<std::string, std::string>;  // name: content

// Returns the lines of the block of shell commands under the heading "Commands", without their comments.
std::vector<std::string> readme_commands() {
  std::istringstream text(read_text_file(SPLATVOL_README).value());
  std::vector<std::string> commands;
  bool is_under_heading = false, is_in_block = false;
  for (std::string line; std::getline(text, line);) {
    if (is_in_block && line == "```") break;
    const std::string command = line.substr(0, line.find_last_not_of(' ', line.find('#') - 1) + 1);
    if (is_in_block && !command.empty()) commands.push_back(command);
    is_under_heading = is_under_heading || line == "## Commands";
    is_in_block = is_in_block || (is_under_heading && line == "```sh");
  }
  return commands;
}

template <class T>
void append(std::string& bytes, std::initializer_list<T> values) {
  for (const T value : values) {
    std::string raw(sizeof(T), '\0');
    std::memcpy(raw.data(), &value, sizeof(T));
    bytes += raw;
  }
}

// A grid of 2 x 2 x 2 points, in binary PLOT3D without record marks.
Files plot3d() {
  Files files;
  std::string& grid = files["grid.xyz"];
  std::string& solution = files["flow.q"];
  for (std::string* file : {&grid, &solution}) append<std::int32_t>(*file, {1, 2, 2, 2});
  for (int axis = 0; axis < 3; ++axis)
    for (int point = 0; point < 8; ++point) append(grid, {static_cast<float>(point >> axis & 1)});
  append(solution, {0.5F, 0.0F, 1000.0F, 0.0F});
  for (const float value : {2.0F, 3.0F, 0.0F, 4.0F, 12.25F})  // density, momentum, energy
    for (int point = 0; point < 8; ++point) append(solution, {value + 0.1F * static_cast<float>(point)});
  return files;
}

// A row of cubes at three times, as OpenFOAM writes them.
Files open_foam() {
  Files files = openfoam_files();
  for (const auto& [name, text] : openfoam_files())
    if (name.starts_with("0.5/"))
      for (const std::string time : {"0.25", "0.75"}) files[time + name.substr(3)] = text;
  files["flow.foam"] = "";
  return files;
}

struct Readme : ProgramTest {
  void SetUp() override {
    ::setenv("SPLATVOL_CACHE", path("cache").c_str(), 1);
    for (const Files& files : {plot3d(), open_foam()})
      for (const auto& [name, content] : files) write(name, content);
    expect_done("svgen mesh --cells 3e4 --pieces 2 -o pieces");
    for (const char* mesh : {"mesh.vtu", "step_0.vtu", "step_1.vtu"}) fs::copy(path("pieces/piece0.vtu"), path(mesh));
    std::string points = "x,y,z,p\n";
    for (int i = 0; i < 64; ++i) points += fmt::format("{},{},{},{}\n", i % 4, i / 4 % 4, i / 16, i);
    write("points.csv", points);
    fs::create_directory(path("folder"));
    expect_done("svbuild gen:points:count=1000 -o folder/shared.svol");
    inputs_ = files_here();
    server_ = Nginx::start(folder_);
    write_ssh(*this);
    ::setenv("PATH", fmt::format("{}bin:{}", folder_, std::getenv("PATH")).c_str(), 1);
  }

  void TearDown() override { ::unsetenv("SPLATVOL_CACHE"); }

  [[nodiscard]] Files files_here() const {
    Files files;
    for (const auto& entry : fs::recursive_directory_iterator(folder_))
      if (entry.is_regular_file()) files[entry.path().string()] = *read_text_file(entry.path().string());
    return files;
  }

  // Expects that a command succeeds, and that no file changes that the user had.
  void expect_works(const std::string& command) const {
    const Outcome outcome = run(command);
    EXPECT_EQ(outcome.code, 0) << command << "\n" << outcome.text;
    for (const auto& [name, content] : inputs_)
      EXPECT_TRUE(read_text_file(name).value_or("") == content) << command << " has changed " << name;
  }

  // The same of svserve, which only a signal ends, after the first file that it offers has been read.
  void expect_serves(const std::string& command) const {
    const Listener free = listen_on_loopback();
    ::close(free.descriptor);
    expect_works(command + fmt::format(" --address 127.0.0.1 --port {} > served.txt & server=$!; ", free.port) +
                 "until grep -q Ctrl-C served.txt || ! kill -0 $server; do sleep 0.05; done; "
                 "svinfo \"$(head -n 1 served.txt)\"; code=$?; kill $server; wait; (exit $code)");
  }

  Files inputs_;
  std::unique_ptr<Nginx> server_;  // null: no nginx on this machine
};

TEST_F(Readme, CommandsWorkAndChangeNoInput) {
  const std::vector<std::string> commands = readme_commands();
  ASSERT_GT(commands.size(), 15u) << "the block of commands has another form now";
  const std::string host = "https://host/", ssh = "ssh://host/";
  const bool has_ffmpeg = run("command -v ffmpeg").code == 0;
  std::string left_out;
  for (std::string command : commands) {
    const std::string program = command.substr(0, command.find(' '));
    const std::size_t address = command.find(host);
    if ((program == "svserve" || address != std::string::npos) && !server_) {
      left_out = "no nginx on this machine (package nginx)";
    } else if (command.find(ssh) != std::string::npos && !has_sftp_server()) {
      left_out = no_sftp_server;
    } else if (program == "svview" && !fs::exists(SPLATVOL_BIN "/svview")) {
      left_out = "built without OpenGL, so there is no svview";
    } else if (command.find("--movie") != std::string::npos && !has_ffmpeg) {
      const Outcome outcome = run(command);
      EXPECT_EQ(outcome.code, 1);
      EXPECT_THAT(outcome.err, testing::HasSubstr("no ffmpeg in PATH: the 120 frames are in"));
    } else if (program == "svserve") {
      expect_serves(command);
    } else {
      if (address != std::string::npos) command.replace(address, host.size(), server_->url(""));
      if (const std::size_t at = command.find(ssh); at != std::string::npos) command.insert(at + ssh.size(), "~/");
      expect_works(command + (program == "svview" ? " --screenshot window.png" : ""));
    }
  }
  if (!left_out.empty()) GTEST_SKIP() << "some commands were left out: " << left_out;
}

}  // namespace
}  // namespace splatvol::test
