// Files that open slowly: the window goes on.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "tests/support/scripted_server.h"
#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr int width = 800, height = 600;

struct SlowFiles : test::ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    write_two_attributes(path("v.svol"));
    resize(width, height);
    open({.recent_files = path("state/recent.json")});
  }
  std::string opened() const { return viewer->session() ? viewer->session()->path() : ""; }
};

using RecentFilesTest = FolderTest;

TEST_F(SlowFiles, AServerThatStallsIsGivenUpByAKey) {
  const ScriptedServer server({Reply{"", Reply::Then::stall}});
  frame({FilesDropped{{path("v.svol")}}});
  settle();
  EXPECT_EQ(opened(), path("v.svol"));
  const Image before = screen();

  frame({FilesDropped{{server.url("far.svol")}}});
  while (server.requests().empty()) std::this_thread::yield();
  for (int i = 0; i < 5; ++i) frame({});
  EXPECT_FALSE(viewer->is_settled());
  EXPECT_EQ(opened(), path("v.svol")) << "the file before stays";
  EXPECT_GT(compare_images(screen(), before)->rmse, 0.001) << "words tell of it";

  press(key::f1);
  press(key::escape);
  frame({});
  EXPECT_FALSE(viewer->is_settled()) << "the list of keys began after it";
  press(key::escape);
  settle();
  EXPECT_TRUE(viewer->messages().all().empty());
  EXPECT_EQ(opened(), path("v.svol"));
  EXPECT_EQ(compare_images(screen(), before)->max, 0);
}

TEST_F(SlowFiles, ClosingDoesNotWaitForAServer) {
  const ScriptedServer server({Reply{"", Reply::Then::stall}});
  frame({FilesDropped{{server.url("far.svol")}}});
  while (server.requests().empty()) std::this_thread::yield();
  const auto start = std::chrono::steady_clock::now();
  viewer.reset();
  // The stall would be ended after half a minute.
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(15));
}

TEST_F(SlowFiles, WhatCannotBeOpenedLeavesTheFileBefore) {
  frame({FilesDropped{{path("v.svol")}}});
  settle();
  frame({FilesDropped{{path("no-such.svol")}}});
  settle();
  EXPECT_EQ(opened(), path("v.svol"));
  ASSERT_EQ(viewer->messages().toasts().size(), 1u);
  EXPECT_THAT(viewer->messages().toasts()[0].text, HasSubstr("no-such.svol"));
}

TEST_F(SlowFiles, TheDialogOpensAFileByItsPathAndByAClick) {
  press_with_control('O');
  frame({});
  for (const char c : path("v.svol")) frame({TextTyped{static_cast<std::uint32_t>(c)}});
  press(key::enter);
  settle();
  EXPECT_EQ(opened(), path("v.svol"));

  press_with_control('W');
  frame({});
  EXPECT_EQ(viewer->session(), nullptr);

  // The dialog begins in the folder of the time before. Its second entry is the file; the first is the folder "state".
  press_with_control('O');
  frame({});
  click(width / 2, height / 2 - 210 + 131);
  settle();
  EXPECT_EQ(opened(), path("v.svol"));
}

TEST_F(RecentFilesTest, AreKept) {
  const std::string list = path("state/recent.json");
  {
    RecentFiles recent(list);
    EXPECT_TRUE(recent.paths().empty());
    recent.add("/data/a.svol");
    recent.add("https://host/b.svol");
    recent.add("https://user:secret@host/c.svol");
    recent.add("https://host/d.svol?key=secret");
    recent.add("ssh://user@host/e.svol");
    recent.add("/data/a.svol");
  }
  EXPECT_THAT(RecentFiles(list).paths(), ElementsAre("/data/a.svol", "ssh://user@host/e.svol", "https://host/b.svol"));
  RecentFiles recent(list);
  for (int i = 0; i < 100; ++i) recent.add(fmt::format("/data/{}.svol", i));
  EXPECT_EQ(RecentFiles(list).paths().size(), 12U);
  EXPECT_EQ(RecentFiles(list).paths().front(), "/data/99.svol");
  for (const char* damaged : {"", "{}", "[1, 2", "[[[[]]]]", "[3]"}) {
    write("state/recent.json", damaged);
    EXPECT_TRUE(RecentFiles(list).paths().empty()) << damaged;
  }
}

}  // namespace
}  // namespace splatvol::test
