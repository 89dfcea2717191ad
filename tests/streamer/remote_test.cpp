// Streaming a volume from a web server.
#include <gtest/gtest.h>

#include "base/http_source.h"
#include "tests/streamer/fixture.h"
#include "tests/support/nginx.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

struct RemoteVolume : FolderTest {
  void SetUp() override {
    nginx_ = Nginx::start(folder_);
    if (!nginx_) GTEST_SKIP() << "no nginx on this machine (package nginx)";
  }

  std::unique_ptr<Nginx> nginx_;
};

TEST_F(RemoteVolume, GivesTheSplatsOfTheFile) {
  ASSERT_TRUE(write_test_volume(sample_volume(3000, 1), path("v.svol")));

  const StreamerOptions options{64u << 20, "a0", KernelKind::moments};
  const auto near = Streamer::open(open_file(path("v.svol")).value(), options).value();
  const auto far = Streamer::open(open_url(nginx_->url("v.svol")).value(), options).value();
  std::mt19937 random(1);
  for (int i = 0; i < 10; ++i) {
    const View view = random_view(random);
    const Detail detail{i < 5 ? 2.0 : 0.0, {}};
    const auto from_file = near->request(view, opaque(), detail);
    const auto from_server = far->request(view, opaque(), detail);
    ASSERT_TRUE(from_file) << from_file.error().message;
    ASSERT_TRUE(from_server) << from_server.error().message;
    EXPECT_TRUE(bytes_of((*from_file)->list) == bytes_of((*from_server)->list));
  }
}

// Each request has to wait for the server, so more bytes are better than more requests.
TEST(CheapGap, JoinsReads) {
  const TestVolume volume = sample_volume(20000, 2);
  const auto control_of = [](std::uint64_t gap) {
    auto control = std::make_shared<TestSource::Control>();
    control->cheap_gap = gap;
    return control;
  };
  const auto strict = control_of(0), generous = control_of(64u << 10);
  const StreamerOptions options{64u << 20, "a0", KernelKind::moments};
  const auto few_bytes = Streamer::open(source_of(volume, strict), options).value();
  const auto few_reads = Streamer::open(source_of(volume, generous), options).value();
  std::mt19937 random(2);
  for (int i = 0; i < 10; ++i) {
    const View view = random_view(random);
    const auto a = few_bytes->request(view, opaque(), Detail{1.0, {}});
    const auto b = few_reads->request(view, opaque(), Detail{1.0, {}});
    ASSERT_TRUE(a && b);
    EXPECT_TRUE(bytes_of((*a)->list) == bytes_of((*b)->list));
  }
  EXPECT_LT(generous->reads, strict->reads / 2);
  EXPECT_GT(few_reads->statistics().bytes_read, few_bytes->statistics().bytes_read);
}

}  // namespace
}  // namespace splatvol::test
