// Sockets on the loopback device.
#pragma once

namespace splatvol::test {

/// A socket that listens on a free port of 127.0.0.1. A client waits until its connection is accepted.
struct Listener {
  int descriptor;
  int port;
};

/// Throws if the system refuses.
[[nodiscard]] Listener listen_on_loopback();

}  // namespace splatvol::test
