// Sessions of files whose bytes come between two calls: their pictures are those of files on a disk.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "base/fetched_source.h"
#include "player/stepped_host.h"
#include "tests/player/session_fixture.h"
#include "tests/player/waves.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

// Files on a server, whose answers come in any order, late or twice.
class Server {
 public:
  [[nodiscard]] Result<std::unique_ptr<ByteSource>> open(const std::string& path) {
    if (const auto opened = files_.find(path); opened != files_.end())
      return FetchedSource::share(opened->second.source);
    std::ifstream file(path, std::ios::binary);
    if (!file) return fail(ErrorCode::io, "{}: no such file", path);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    File& opened = files_[path];
    opened.content.assign(reinterpret_cast<const std::byte*>(text.data()),
                          reinterpret_cast<const std::byte*>(text.data() + text.size()));
    opened.source = std::make_shared<FetchedSource>(path, text.size(), held_bytes);
    return FetchedSource::share(opened.source);
  }

  /// Answers some requests.
  void answer() {
    for (auto& [path, file] : files_) {
      for (const ByteRange& range : file.source->take_wanted()) {
        ++requests;
        bytes += range.end - range.begin;
        file.asked.push_back(range);
      }
      std::ranges::shuffle(file.asked, random_);
      const std::size_t late = file.asked.size() / 3;
      for (; file.asked.size() > late; file.asked.pop_back()) {
        const ByteRange& range = file.asked.back();
        if (is_gone) {
          file.source->refuse(range, {ErrorCode::io, path + ": the server has gone"});
          continue;
        }
        for (int times = 0; times < 2; ++times)
          file.source->deliver(range, {file.content.begin() + static_cast<std::ptrdiff_t>(range.begin),
                                       file.content.begin() + static_cast<std::ptrdiff_t>(range.end)});
      }
    }
  }

  std::uint64_t requests = 0, bytes = 0;
  std::uint64_t held_bytes = std::uint64_t{16} << 20;
  bool is_gone = false;

 private:
  struct File {
    std::vector<std::byte> content = {};
    std::shared_ptr<FetchedSource> source = {};
    std::vector<ByteRange> asked = {};
  };
  std::map<std::string, File> files_;
  std::mt19937 random_{1};
};

struct Pending : SessionFixture {
  Pending() : SessionFixture(80, 60) {}

  [[nodiscard]] std::unique_ptr<Session> open_far(const std::string& file, const std::string& scene = "") {
    const auto open = [this](const std::string& path) { return server.open(path); };
    Task<Result<SessionFile>> reading(stepped, [&] { return Session::read({.file = file}, scene, settings, open); });
    for (int tries = 0; !reading.wait(); ++tries) {
      if (tries > 1000) return nullptr;
      server.answer();
    }
    return value_of(Session::open(value_of(reading.take()), stepped));
  }
  [[nodiscard]] Image settled_far(Session& session) {
    for (int calls = 0; calls < 5000; ++calls) {
      draw(session);
      if (session.is_settled()) return value_of(session.image());
      server.answer();
    }
    ADD_FAILURE() << "it asks for bytes without an end";
    return {};
  }
  void expect_same(Session& far, Session& near) {
    const Image expected = settled(near), image = settled_far(far);
    ASSERT_EQ(image.pixels.size(), expected.pixels.size());
    EXPECT_EQ(compare_images(image, expected)->max, 0);
    EXPECT_THAT(far.troubles(), testing::IsEmpty());
    EXPECT_GT(server.requests, 0U);
    EXPECT_LE(server.bytes, 1.05 * static_cast<double>(far.file_bytes())) << "none is fetched twice";
  }

  SteppedHost stepped;
  Server server;
};

TEST_F(Pending, PicturesOfSplatsAreTheSame) {
  write_two_attributes(path("v.svol"));
  const auto near = open(path("v.svol"));
  const auto far = open_far(path("v.svol"));
  expect_same(*far, *near);
  for (Session* session : {near.get(), far.get()}) session->show_attribute("a1");
  expect_same(*far, *near);
  for (Session* session : {near.get(), far.get()})
    session->scene.camera.position += 0.3 * (session->scene.camera.focal_point - session->scene.camera.position);
  expect_same(*far, *near);
}

TEST_F(Pending, ExactPicturesAreTheSame) {
  build_mesh(lattice(12), waves, path("m.svol"), {.keep_cells = true});
  const auto near = open(path("m.svol"));
  const auto far = open_far(path("m.svol"));
  expect_same(*far, *near);
  EXPECT_TRUE(far->exact());
}

TEST_F(Pending, LittleMemoryIsEnough) {
  build_mesh(lattice(20), waves, path("m.svol"), {.keep_cells = true});
  settings.memory = std::uint64_t{8} << 20;
  server.held_bytes = settings.memory / 4;
  const auto near = open(path("m.svol"));
  const auto far = open_far(path("m.svol"));
  expect_same(*far, *near);
}

TEST_F(Pending, AHandMovesWhileBytesCome) {
  build_mesh(lattice(12), waves, path("m.svol"), {.keep_cells = true});
  const auto near = open(path("m.svol"));
  const auto far = open_far(path("m.svol"));
  for (int frame = 0; frame < 40; ++frame) {
    far->scene.camera.position.x += 0.01;
    draw(*far, 0.01);
    if (frame % 3 == 0) server.answer();
  }
  near->scene.camera = far->scene.camera;
  expect_same(*far, *near);
}

TEST_F(Pending, AChangeCanBeTakenBack) {
  write_two_attributes(path("v.svol"));
  const auto far = open_far(path("v.svol"));
  const Image before = settled_far(*far);
  far->show_attribute("a1");
  for (int call = 0; call < 5; ++call) draw(*far);
  EXPECT_TRUE(far->is_reading()) << "nothing has come";
  far->cancel_reading();
  EXPECT_EQ(compare_images(settled_far(*far), before)->max, 0);
  EXPECT_EQ(far->attribute().name, "a0");
}

TEST_F(Pending, StepsOfASeriesAreTheSame) {
  write_series(path("s.svol"));
  const auto near = open(path("s.svol"));
  const auto far = open_far(path("s.svol"));
  expect_same(*far, *near);
  for (Session* session : {near.get(), far.get()}) session->choose_step(0);
  expect_same(*far, *near);
  EXPECT_EQ(far->step(), 0U);
  far->toggle_playing();
  for (int calls = 0; calls < 1000 && far->is_playing(); ++calls) {
    EXPECT_TRUE(far->play(long_time));
    draw(*far);
    server.answer();
  }
  for (Session* session : {near.get(), far.get()}) session->choose_step(2);
  expect_same(*far, *near);
}

TEST_F(Pending, ContoursAndSlicesAreTheSame) {
  build_mesh(lattice(12), waves, path("m.svol"), {.keep_cells = true});
  const auto near = open(path("m.svol"));
  const auto far = open_far(path("m.svol"));
  for (Session* session : {near.get(), far.get()}) {
    session->scene.contours = {{.values = {0.4}}};
    session->scene.slices = {{.point = dvec3(0.5), .normal = {1, 0, 0}}};
  }
  expect_same(*far, *near);
}

TEST_F(Pending, AServerThatHasGoneIsToldOnce) {
  write_two_attributes(path("v.svol"));
  const auto far = open_far(path("v.svol"));
  const Image before = settled_far(*far);
  server.is_gone = true;
  far->show_attribute("a1");
  EXPECT_EQ(compare_images(settled_far(*far), before)->max, 0);
  ASSERT_EQ(far->troubles().size(), 1U);
  EXPECT_THAT(far->troubles()[0], HasSubstr("the server has gone"));
  server.is_gone = false;
  far->show_attribute("a1");
  static_cast<void>(settled_far(*far));
  EXPECT_EQ(far->attribute().name, "a1");
  EXPECT_EQ(far->troubles().size(), 1U);
}

}  // namespace
}  // namespace splatvol::test
