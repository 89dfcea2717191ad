// A volume on a web server, streamed.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>

#include "base/http_source.h"
#include "tests/streamer/fixture.h"
#include "tests/support/nginx.h"

namespace splatvol {
namespace {

template <class T>
bool same_bytes(std::span<const T> a, std::span<const T> b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

TEST(RemoteVolume, GivesTheSplatsOfTheFile) {
  std::string name = (std::filesystem::temp_directory_path() / "splatvol_remote_test.XXXXXX").string();
  const std::filesystem::path folder = ::mkdtemp(name.data());
  auto nginx = test::Nginx::start(folder);
  if (!nginx) GTEST_SKIP() << "no nginx on this machine (package nginx)";
  const std::string path = folder / "v.svol";
  ASSERT_TRUE(test::write_test_volume(test::sample_volume(3000, 1), path));

  const StreamerOptions options{64u << 20, "a0", KernelKind::moments};
  const auto near = Streamer::open(open_file(path).value(), options).value();
  const auto far = Streamer::open(open_url(nginx->url("v.svol")).value(), options).value();
  std::mt19937 random(1);
  for (int i = 0; i < 10; ++i) {
    const View view = test::random_view(random);
    const DetailOptions detail{i < 5 ? 2.0 : 0.0, {}};
    const auto from_file = near->request(view, test::opaque(), detail);
    const auto from_server = far->request(view, test::opaque(), detail);
    ASSERT_TRUE(from_file) << from_file.error().message;
    ASSERT_TRUE(from_server) << from_server.error().message;
    EXPECT_TRUE(same_bytes(std::get<std::span<const MomentsSplat>>((*from_file)->data),
                           std::get<std::span<const MomentsSplat>>((*from_server)->data)));
  }
  EXPECT_EQ(far->statistics().bytes_read, near->statistics().bytes_read);
  nginx.reset();
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace splatvol
