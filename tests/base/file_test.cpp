#include "base/file.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/locked_file.h"
#include "base/replaceable.h"
#include "base/temporary_names.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using namespace ::testing;

std::span<const std::byte> bytes_of(const std::string& text) { return std::as_bytes(std::span(text)); }

using FileTest = FolderTest;
using Names = std::vector<std::string>;

void expect_one_line_about(const Error& error, const std::string& path) {
  EXPECT_EQ(error.code, ErrorCode::io);
  EXPECT_THAT(error.message, StartsWith(path + ": "));
  EXPECT_THAT(error.message, Not(HasSubstr("\n")));
}

// --- Reading.

/// A file and a memory source with the same ten bytes. Both must keep the same contract.
struct ByteSourceTest : FileTest, testing::WithParamInterface<bool> {
  std::unique_ptr<ByteSource> open_digits() {
    if (!GetParam()) return memory_source(bytes_of(digits_), "memory");
    write("digits", digits_);
    return std::move(open_file(path("digits")).value());
  }

  std::string digits_ = "0123456789";
};

INSTANTIATE_TEST_SUITE_P(Source, ByteSourceTest, testing::Bool(),
                         [](const auto& suite) { return suite.param ? "File" : "Memory"; });

TEST_P(ByteSourceTest, ReadsEveryRangeInsideAndNoneThatLeavesIt) {
  const auto source = open_digits();
  ASSERT_EQ(source->size(), digits_.size());

  for (std::size_t offset = 0; offset <= digits_.size() + 2; ++offset) {
    for (std::size_t count = 0; count <= digits_.size() + 2; ++count) {
      std::string out(count, '?');
      const Status status = source->read(offset, std::as_writable_bytes(std::span(out)));
      if (offset + count <= digits_.size()) {
        ASSERT_TRUE(status) << offset << '+' << count << ": " << status.error().message;
        EXPECT_EQ(out, digits_.substr(offset, count));
      } else {
        ASSERT_FALSE(status) << offset << '+' << count;
        EXPECT_EQ(status.error().code, ErrorCode::invalid_data);
        EXPECT_EQ(out, std::string(count, '?')) << "a refused read touched the buffer";
      }
    }
  }
}

TEST_P(ByteSourceTest, RefusesOffsetsWhoseSumWithTheLengthWraps) {
  const auto source = open_digits();
  constexpr auto largest = std::numeric_limits<std::uint64_t>::max();
  constexpr auto half = std::uint64_t{1} << 63;
  std::array<std::byte, 8> out{};

  // The bounds check must refuse these before the system gets an offset that is negative as an off_t.
  for (const std::uint64_t offset : {largest, largest - 1, largest - 7, largest - 8, half, half - 1, half - 8}) {
    EXPECT_THAT(source->read(offset, out), FailsWith(ErrorCode::invalid_data)) << offset;
  }
  EXPECT_FALSE(source->read(largest, {}));
}

TEST_P(ByteSourceTest, NamesItselfInErrors) {
  const auto source = open_digits();
  std::array<std::byte, 4> out{};
  const std::string status = message_of(source->read(8, out));
  EXPECT_THAT(status, StartsWith(source->name() + ": "));
  EXPECT_THAT(status, HasSubstr("4 bytes at 8"));
}

TEST_F(FileTest, FileThatShrinksWhileOpenIsAnError) {
  write("shrinking", std::string(100, 'x'));
  const auto source = open_file(path("shrinking")).value();
  std::filesystem::resize_file(path("shrinking"), 60);

  std::array<std::byte, 50> out{};
  EXPECT_TRUE(source->read(10, out));
  const Status status = source->read(50, out);
  ASSERT_FALSE(status);
  expect_one_line_about(status.error(), path("shrinking"));
}

TEST_F(FileTest, OpenRefusesWhatIsNoRegularFile) {
  const auto missing = open_file(path("missing"));
  ASSERT_FALSE(missing);
  expect_one_line_about(missing.error(), path("missing"));
  EXPECT_THAT(missing.error().message, HasSubstr("No such file"));

  fs::create_directory(path("folder"));
  const auto folder = open_file(path("folder"));
  ASSERT_FALSE(folder);
  expect_one_line_about(folder.error(), path("folder"));
}

TEST_F(FileTest, ANameDoesNotEndInItsMiddle) {
  write("a", "other");
  EXPECT_THAT(message_of(open_file(path("a") + std::string("\0b", 2))), HasSubstr("NUL"));
}

TEST_F(FileTest, ReadTextFileKeepsEveryByte) {
  const std::string text("a\0b\r\n\xff", 6);
  write("text", text);
  EXPECT_EQ(read_text_file(path("text")).value(), text);
  write("empty", "");
  EXPECT_EQ(read_text_file(path("empty")).value(), "");
  EXPECT_FALSE(read_text_file(path("missing")));
}

// --- Writing.

TEST_F(FileTest, NothingStandsAtThePathBeforeCommit) {
  auto file = AtomicFile::create(path("new")).value();
  ASSERT_TRUE(file.append(bytes_of("whole")));
  EXPECT_FALSE(fs::exists(path("new")));
  EXPECT_TRUE(names().empty()) << "what is killed leaves nothing behind";

  ASSERT_TRUE(file.commit());
  EXPECT_EQ(read("new"), "whole");
  EXPECT_EQ(names(), Names{"new"});
}

TEST_F(FileTest, CommitReplacesAnOldFile) {
  write("old", "much longer than the new content");
  auto file = AtomicFile::create(path("old")).value();
  ASSERT_TRUE(file.append(bytes_of("short")));
  EXPECT_EQ(read("old"), "much longer than the new content");
  ASSERT_TRUE(file.commit());
  EXPECT_EQ(read("old"), "short");
}

TEST_F(FileTest, OnlyAFileOfTheSameKindIsReplaced) {
  const std::map<std::string, std::string> starts = {
      {"a.svol", "\x89SVOL\r\n\x1a"},       {"a.PNG", "\x89PNG\r\n\x1a\n"}, {"a.exr", "\x76\x2f\x31\x01"},
      {"a.json", " \n{\"camera\": {}}"},    {"a.npy", "\x93NUMPY"},         {"a.vdb", std::string(" BDV\0\0\0\0", 8)},
      {"a.vtu", "<?xml version=\"1.0\"?>"}, {"a.vtp", "<VTKFile"},          {"a.glb", "glTF"}};
  for (const auto& [name, start] : starts) {
    write(name, start + " and more");
    EXPECT_TRUE(check_replaceable(path(name), Replace::any)) << name;
    EXPECT_TRUE(AtomicFile::create(path(name), AtomicFile::Unnamed::if_possible, Replace::any)) << name;
    for (const std::string other : {"text", "\x89", " "}) {
      write(name, other);
      const auto status = check_replaceable(path(name), Replace::any);
      ASSERT_FALSE(status) << name << " holds " << other;
      EXPECT_EQ(status.error().code, ErrorCode::invalid_argument);
      EXPECT_TRUE(status.error().message.starts_with(path(name)));
      EXPECT_FALSE(AtomicFile::create(path(name), AtomicFile::Unnamed::if_possible, Replace::any)) << name;
    }
    write(name, "");
    EXPECT_TRUE(check_replaceable(path(name))) << name << ": empty";
  }
  EXPECT_TRUE(check_replaceable(path("none.svol")));
  write("text", "any");
  EXPECT_TRUE(check_replaceable(path("text")));

  // A file that appears while another is written stays.
  auto file = AtomicFile::create(path("late.svol")).value();
  write("late.svol", "a letter");
  EXPECT_FALSE(file.commit());
  EXPECT_EQ(read("late.svol"), "a letter");
}

// The start of a .vdb file whose metadata have the mark of an export with another UUID, or with its own.
std::string vdb_with(const std::string& uuid, const std::string& mark) {
  return std::string(" BDV\0\0\0\0", 8) + std::string(13, '\1') + uuid + std::string(20, '\2') + mark + " more";
}

// A mesh of the user's has no mark, however near to one its text comes. Marks do not survive a change.
TEST_F(FileTest, WhatMayBeAnInputIsReplacedIfItHasAMarkOnly) {
  const std::string uuid(36, 'a'), other_uuid(36, 'b'), declared = "<?xml version=\"1.0\"?>\n";
  const std::string mark(vtk_export_mark), element = "<VTKFile type=\"UnstructuredGrid\">\n";
  const std::vector<std::pair<std::string, std::string>> exports = {
      {"a.vtu", declared + mark + "\n" + element},
      {"a.VTU", declared + "<!-- mine -->" + mark + element},
      {"a.vtp", declared + mark + element},
      {"a.stl", std::string(stl_export_mark) + std::string(70, '\0')},
      {"a.glb", "glTF {\"asset\":{" + std::string(glb_export_mark)},
      {"a.vdb", vdb_with(uuid, vdb_export_mark(uuid))}};
  for (const auto& [name, content] : exports) {
    write(name, content);
    EXPECT_TRUE(check_replaceable(path(name))) << name;
    EXPECT_TRUE(AtomicFile::create(path(name))) << name;
  }

  const std::vector<std::pair<std::string, std::string>> inputs = {
      {"a.vtu", declared + element},
      {"a.vtu", element + mark},
      {"a.vtu", declared + "<!-- splatvol -->" + element},
      {"a.vtu", declared + "<!--" + std::string(4096, ' ') + "-->" + mark + element},
      {"a.vdb", vdb_with(uuid, vdb_export_mark(other_uuid))},
      {"a.vdb", vdb_with(uuid, "")},
      {"a.vdb", " BDV"},
      {"a.stl", "solid " + std::string(stl_export_mark)},
      {"a.glb", "glTF {\"asset\":{\"generator\":\"another\""},
      {"a.csv", "x,y,z\n"},
      {"a.npy", "\x93NUMPY" + mark}};
  for (const auto& [name, content] : inputs) {
    write(name, content);
    const auto status = check_replaceable(path(name));
    ASSERT_FALSE(status) << content;
    EXPECT_EQ(status.error().code, ErrorCode::invalid_argument);
    EXPECT_TRUE(status.error().message.starts_with(path(name)));
    EXPECT_NE(status.error().message.find("--force"), std::string::npos);
    EXPECT_FALSE(AtomicFile::create(path(name))) << content;
    EXPECT_TRUE(check_replaceable(path(name), Replace::any)) << content;
  }

  // A link names what it points to. A file that appears while another is written stays.
  fs::create_symlink(path("a.npy"), path("link.npy"));
  EXPECT_FALSE(check_replaceable(path("link.npy")));
  auto file = AtomicFile::create(path("late.vtu")).value();
  write("late.vtu", declared + element);
  EXPECT_FALSE(file.commit());
  EXPECT_EQ(read("late.vtu"), declared + element);
}

TEST_F(FileTest, DestroyedWithoutCommitLeavesTheOldFile) {
  write("old", "old");
  {
    auto file = AtomicFile::create(path("old")).value();
    ASSERT_TRUE(file.append(bytes_of("new")));
  }
  EXPECT_EQ(read("old"), "old");
  EXPECT_EQ(names(), Names{"old"});
}

/// Makes writes past `limit` bytes of a file fail, as on a full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t limit) {
    ::getrlimit(RLIMIT_FSIZE, &old_);
    old_handler_ = std::signal(SIGXFSZ, SIG_IGN);
    const rlimit lowered{limit, old_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &lowered);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &old_);
    std::signal(SIGXFSZ, old_handler_);
  }

 private:
  rlimit old_{};
  void (*old_handler_)(int) = SIG_DFL;
};

TEST_F(FileTest, FailedWriteLeavesTheOldFile) {
  write("old", "old");
  {
    auto file = AtomicFile::create(path("old")).value();
    const FileSizeLimit limit(1000);
    EXPECT_TRUE(file.append(bytes_of(std::string(900, 'x'))));

    // 100 of these bytes still fit: a partial write must not count as done.
    const Status status = file.append(bytes_of(std::string(900, 'y')));
    ASSERT_FALSE(status);
    expect_one_line_about(status.error(), path("old"));
    EXPECT_EQ(file.position(), 900U);
  }
  EXPECT_EQ(read("old"), "old");
  EXPECT_EQ(names(), Names{"old"});
}

TEST_F(FileTest, FailedCommitLeavesTheOldContent) {
  {
    auto file = AtomicFile::create(path("taken")).value();
    fs::create_directory(path("taken"));
    write("taken/inside", "old");
    ASSERT_TRUE(file.append(bytes_of("new")));
    const Status status = file.commit();
    ASSERT_FALSE(status);
    expect_one_line_about(status.error(), path("taken"));
  }
  EXPECT_EQ(read("taken/inside"), "old");
  EXPECT_EQ(names().size(), 2u) << "the finished file is kept too";
}

TEST_F(FileTest, WriteAtPatchesWithoutMovingTheEnd) {
  auto file = AtomicFile::create(path("patched")).value();
  ASSERT_TRUE(file.append(bytes_of("____5678")));
  ASSERT_TRUE(file.write_at(0, bytes_of("1234")));
  EXPECT_EQ(file.position(), 8U);
  ASSERT_TRUE(file.append(bytes_of("9")));
  ASSERT_TRUE(file.commit());
  EXPECT_EQ(read("patched"), "123456789");
}

TEST_F(FileTest, HolesReadAsZeros) {
  auto file = AtomicFile::create(path("holed")).value();
  file.seek(4);
  ASSERT_TRUE(file.append(bytes_of("end")));
  ASSERT_TRUE(file.commit());
  EXPECT_EQ(read("holed"), std::string("\0\0\0\0end", 7));
}

// Inserts ranges that some file systems can insert, and others, which are always copied.
TEST_F(FileTest, InsertFrontMovesAllBytesAndTheEnd) {
  std::string text(9'000'000, ' ');  // more than is copied at once
  for (std::size_t i = 0; i < text.size(); ++i) text[i] = static_cast<char>('a' + i * i % 23);
  for (const std::uint64_t front : {std::uint64_t{0}, std::uint64_t{5}, AtomicFile::insertable_bytes,
                                    3 * AtomicFile::insertable_bytes, std::uint64_t{10'000'000}}) {
    auto file = AtomicFile::create(path("moved")).value();
    ASSERT_TRUE(file.append(bytes_of(text)));
    ASSERT_TRUE(file.insert_front(front));
    EXPECT_EQ(file.position(), front + text.size());
    ASSERT_TRUE(file.append(bytes_of("end")));
    ASSERT_TRUE(file.write_at(0, bytes_of(std::string(front, '.'))));
    ASSERT_TRUE(file.commit());
    EXPECT_TRUE(read("moved") == std::string(front, '.') + text + "end") << front;
  }
}

TEST_F(FileTest, InsertFrontOfNothingMovesTheEnd) {
  auto file = AtomicFile::create(path("empty")).value();
  ASSERT_TRUE(file.insert_front(AtomicFile::insertable_bytes));
  EXPECT_EQ(file.position(), AtomicFile::insertable_bytes);
  ASSERT_TRUE(file.commit());
  EXPECT_EQ(read("empty"), "");
}

TEST_F(FileTest, WriteAtRefusesOffsetsThatNoFileHas) {
  auto file = AtomicFile::create(path("far")).value();
  EXPECT_FALSE(file.write_at(std::numeric_limits<std::uint64_t>::max(), bytes_of("x")));
  EXPECT_FALSE(file.write_at(std::uint64_t{1} << 63, bytes_of("x")));
}

TEST_F(FileTest, MovedFileIsCommittedOnce) {
  {
    auto first = AtomicFile::create(path("moved")).value();
    ASSERT_TRUE(first.append(bytes_of("one ")));
    AtomicFile second = std::move(first);
    ASSERT_TRUE(second.append(bytes_of("two")));
    ASSERT_TRUE(second.commit());
  }
  EXPECT_EQ(read("moved"), "one two");
  EXPECT_EQ(names(), Names{"moved"});
}

TEST_F(FileTest, CommitGivesTheDescriptorBack) {
  write("digits", "0123456789");
  std::unique_ptr<ByteSource> source;
  {
    auto file = AtomicFile::create(path("committed")).value();
    ASSERT_TRUE(file.commit());
    source = open_file(path("digits")).value();
  }
  // Closing twice would close the descriptor of the source, which has the same number.
  std::array<std::byte, 4> out{};
  EXPECT_TRUE(source->read(0, out));
}

TEST_F(FileTest, PermissionsFollowTheUmask) {
  const mode_t old_mask = ::umask(0);
  for (const mode_t mask : {0000U, 0022U, 0027U, 0077U}) {
    ::umask(mask);
    auto file = AtomicFile::create(path("permitted")).value();
    EXPECT_TRUE(file.commit());
    EXPECT_EQ(::umask(mask), mask) << "create changed the umask";

    struct stat status {};
    EXPECT_EQ(::stat(path("permitted").c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 07777U, 0666U & ~mask);
    fs::remove(path("permitted"));
  }
  ::umask(old_mask);
}

TEST_F(FileTest, AReplacedFileKeepsItsRights) {
  for (const mode_t rights : {0600U, 0640U, 0444U}) {
    write("old", "old");
    ASSERT_EQ(::chmod(path("old").c_str(), rights), 0);
    auto file = AtomicFile::create(path("old")).value();
    ASSERT_TRUE(file.append(bytes_of("new")));
    ASSERT_TRUE(file.commit());
    struct stat status {};
    ASSERT_EQ(::stat(path("old").c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 07777U, rights);
    EXPECT_EQ(read("old"), "new");
    fs::remove(path("old"));
  }
}

// What replaces a private file is never readable by others, also while it is written.
TEST_F(FileTest, WhatReplacesAPrivateFileIsPrivateFromTheFirstByte) {
  for (const auto unnamed : {AtomicFile::Unnamed::if_possible, AtomicFile::Unnamed::never}) {
    write("old", "old");
    ASSERT_EQ(::chmod(path("old").c_str(), 0600), 0);
    auto file = AtomicFile::create(path("old"), unnamed).value();
    struct stat status {};
    ASSERT_EQ(::stat(file.path_to_write().c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 07777U, 0600U);
    ASSERT_TRUE(file.append(bytes_of("new")));
    ASSERT_TRUE(file.commit());
    ASSERT_EQ(::stat(path("old").c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 07777U, 0600U);
  }
}

TEST_F(FileTest, AReplacedFileKeepsItsOwnerWhereRootWritesIt) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root may";
  write("old", "old");
  ASSERT_EQ(::chown(path("old").c_str(), 1234, 5678), 0);
  auto file = AtomicFile::create(path("old")).value();
  ASSERT_TRUE(file.commit());
  struct stat status {};
  ASSERT_EQ(::stat(path("old").c_str(), &status), 0);
  EXPECT_EQ(status.st_uid, 1234U);
  EXPECT_EQ(status.st_gid, 5678U);
}

TEST_F(FileTest, LongNamesAreTakenAndTooLongOnesRefusedAtOnce) {
  const std::string longest(255, 'a');
  for (const auto unnamed : {AtomicFile::Unnamed::if_possible, AtomicFile::Unnamed::never}) {
    auto file = AtomicFile::create(path(longest), unnamed).value();
    EXPECT_TRUE(file.commit());
    EXPECT_EQ(names(), Names{longest});
  }
  EXPECT_THAT(message_of(AtomicFile::create(path(longest + "a"))), HasSubstr("too long"));
}

TEST_F(FileTest, LinksInACircleAreRefused) {
  fs::create_symlink("b", path("a"));
  fs::create_symlink("a", path("b"));
  const auto file = AtomicFile::create(path("a"));
  ASSERT_FALSE(file);
  expect_one_line_about(file.error(), path("a"));
}

TEST_F(FileTest, AFileThatCannotGetItsNameStaysBesideIt) {
  for (const auto unnamed : {AtomicFile::Unnamed::if_possible, AtomicFile::Unnamed::never}) {
    auto file = AtomicFile::create(path("taken"), unnamed).value();
    ASSERT_TRUE(file.append(bytes_of("hours of work")));
    fs::create_directory(path("taken"));
    const std::string committed = message_of(file.commit());
    fs::remove(path("taken"));
    const Names left = names();
    ASSERT_EQ(left.size(), 1u);
    EXPECT_THAT(committed, HasSubstr(left[0]));
    EXPECT_EQ(read(left[0]), "hours of work");
    fs::remove(path(left[0]));
  }
}

TEST_F(FileTest, WithoutConfirmationNothingStaysOfAFileThatCannotGetItsName) {
  for (const auto unnamed : {AtomicFile::Unnamed::if_possible, AtomicFile::Unnamed::never}) {
    {
      auto file = AtomicFile::create(path("taken"), unnamed).value();
      fs::create_directory(path("taken"));
      EXPECT_FALSE(file.commit_unconfirmed());
    }
    EXPECT_EQ(names(), Names{"taken"});
    fs::remove(path("taken"));
  }
  auto file = AtomicFile::create(path("free")).value();
  ASSERT_TRUE(file.append(bytes_of("text")));
  ASSERT_TRUE(file.commit_unconfirmed());
  ASSERT_TRUE(sync_folder(folder_));
  EXPECT_EQ(read("free"), "text");
  EXPECT_FALSE(sync_folder(path("missing")));
}

TEST_F(FileTest, RenamesToFreeNamesOnly) {
  write("a", "a");
  write("b", "b");
  fs::create_symlink("nowhere", path("link"));
  for (const char* taken : {"b", "link"}) EXPECT_FALSE(rename_if_free(path("a"), path(taken)).value()) << taken;
  EXPECT_EQ(read("b"), "b");
  EXPECT_TRUE(rename_if_free(path("a"), path("c")).value());
  EXPECT_EQ(read("c"), "a");
  EXPECT_EQ(names(), (Names{"b", "c", "link"}));
  const auto missing = rename_if_free(path("a"), path("d"));
  ASSERT_FALSE(missing);
  expect_one_line_about(missing.error(), path("a"));
}

TEST_F(FileTest, AFileIsLockedOnce) {
  using IfTaken = LockedFile::IfTaken;
  write("a", "a");
  {
    const auto first = value_of(LockedFile::open(path("a"), IfTaken::fail));
    EXPECT_TRUE(first.is_locked());
    EXPECT_THAT(message_of(LockedFile::open(path("a"), IfTaken::fail)), HasSubstr("another program appends to it"));
    // The lock is that of the file, and not of the name.
    ASSERT_TRUE(write_text_file(path("a"), "new"));
    EXPECT_TRUE(LockedFile::open(path("a"), IfTaken::fail));
  }
  EXPECT_TRUE(LockedFile::open(path("a"), IfTaken::wait));
  EXPECT_FALSE(LockedFile::open(path("missing"), IfTaken::wait));
  EXPECT_FALSE(LockedFile::open(folder_, IfTaken::wait));
}

TEST_F(FileTest, WithoutLinksToUnnamedFilesACopyGetsTheName) {
  const pid_t child = ::fork();
  if (child == 0) {
    // linkat fails, as on some network file systems.
    const std::array<sock_filter, 4> filter = {{BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
                                                BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_linkat, 0, 1),
                                                BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EXDEV),
                                                BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)}};
    const sock_fprog program{filter.size(), const_cast<sock_filter*>(filter.data())};
    if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0)
      ::_exit(2);
    auto file = AtomicFile::create(path("copied")).value();
    const std::string text(10'000'000, 'x');
    ::_exit(file.append(bytes_of(text)) && file.commit() && read("copied") == text ? 0 : 1);
  }
  int status = -1;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  if (WEXITSTATUS(status) == 2) GTEST_SKIP() << "no seccomp here";
  EXPECT_EQ(status, 0);
  EXPECT_EQ(names(), Names{"copied"});
}

TEST_F(FileTest, ASignalHandlerRemovesTemporaryNames) {
  {
    auto first = AtomicFile::create(path("first"), AtomicFile::Unnamed::never).value();
    auto second = AtomicFile::create(path("second"), AtomicFile::Unnamed::never).value();
    ASSERT_TRUE(first.commit());
    EXPECT_EQ(names().size(), 2u);
    remove_temporaries();
    EXPECT_EQ(names(), Names{"first"});
  }
  // A folder goes with its files.
  fs::create_directory(path("folder"));
  write("folder/a", "a");
  write("folder/b", "b");
  note_temporary(path("folder"));
  remove_temporaries();
  forget_temporary(path("folder"));
  EXPECT_EQ(names(), Names{"first"});
  // As many as there are.
  for (int i = 0; i < 200; ++i) {
    write(fmt::format("file{}", i), "");
    note_temporary(path(fmt::format("file{}", i)));
  }
  remove_temporaries();
  for (int i = 0; i < 200; ++i) forget_temporary(path(fmt::format("file{}", i)));
  EXPECT_EQ(names(), Names{"first"});
  // A name that is forgotten stays.
  note_temporary(path("first"));
  forget_temporary(path("first"));
  remove_temporaries();
  EXPECT_EQ(names(), Names{"first"});
}

TEST_F(FileTest, CreateRefusesAFolderThatIsNone) {
  write("file", "");
  for (const std::string& target : {path("missing/new"), path("file/new")}) {
    const auto file = AtomicFile::create(target);
    ASSERT_FALSE(file);
    expect_one_line_about(file.error(), target);
  }
  EXPECT_EQ(names(), Names{"file"});
}

/// Drops root's right to write anywhere during its lifetime. No effect for other users.
class UnprivilegedUser {
 public:
  UnprivilegedUser() : id_(::geteuid()) {
    if (id_ == 0) dropped_ = ::seteuid(nobody) == 0;
  }
  UnprivilegedUser(const UnprivilegedUser&) = delete;
  UnprivilegedUser& operator=(const UnprivilegedUser&) = delete;
  ~UnprivilegedUser() {
    if (dropped_ && ::seteuid(id_) != 0) std::abort();
  }

  [[nodiscard]] bool privileged() const { return id_ == 0 && !dropped_; }

 private:
  static constexpr uid_t nobody = 65534;
  uid_t id_;
  bool dropped_ = false;
};

TEST_F(FileTest, CreateRefusesAFolderThatMayNotBeWritten) {
  const auto locked = fs::perms::owner_read | fs::perms::owner_exec | fs::perms::others_read | fs::perms::others_exec;
  fs::permissions(folder_, locked);
  {
    const UnprivilegedUser user;
    if (user.privileged()) GTEST_SKIP() << "root cannot become another user here";
    const auto file = AtomicFile::create(path("new"));
    ASSERT_FALSE(file);
    expect_one_line_about(file.error(), path("new"));
    EXPECT_THAT(file.error().message, HasSubstr("Permission denied"));
  }
  fs::permissions(folder_, fs::perms::owner_all);
  EXPECT_EQ(names(), Names{});
}

TEST_F(FileTest, RefusesWhatIsNoRegularFileAndFollowsLinks) {
  const std::string pipe = path("pipe"), link = path("link"), file = path("file");
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_FALSE(AtomicFile::create(pipe));
  fs::create_directory(path("folder"));
  EXPECT_FALSE(AtomicFile::create(path("folder")));
  EXPECT_TRUE(fs::is_fifo(pipe));

  write("file", "old");
  fs::create_symlink("file", link);
  auto target = value_of(AtomicFile::create(link));
  ASSERT_TRUE(target.append(std::as_bytes(std::span("new", 3))));
  ASSERT_TRUE(target.commit());
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_EQ(read("file"), "new");
}

}  // namespace
}  // namespace splatvol::test
