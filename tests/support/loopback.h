// Sockets of this machine only.
#pragma once

namespace splatvol::test {

/// A socket that listens on a free port of 127.0.0.1. Who connects waits until somebody accepts.
struct Listener {
  int descriptor;
  int port;
};

/// Throws where the system refuses.
[[nodiscard]] Listener listen_on_loopback();

}  // namespace splatvol::test
