// Network cameras as processes' threads on loopback: MJPEG over HTTP, and raw video over RTSP. They can
// vanish, hang and skip frames.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/numbered_image.h"

namespace gnathion::test {

/// Serves one client at a time, a frame every 1/rate s of its own time, numbered from 0 with each start.
class VideoPeer {
 public:
  explicit VideoPeer(double rate_hz) : rate_hz_(rate_hz) {}
  virtual ~VideoPeer() = default;
  VideoPeer(const VideoPeer&) = delete;
  VideoPeer& operator=(const VideoPeer&) = delete;

  int port() const { return port_; }
  /// Listens on a free port, later on the same again.
  void start() {
    over_ = hang_ = false;
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const int yes = 1;
    ::setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(port_));
    if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) ::abort();
    ::listen(listener_, 4);
    socklen_t size = sizeof address;
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this] { accept_clients(); });
  }
  /// Gone from one moment to the next.
  void stop() {
    over_ = true;
    changed_.notify_all();
    if (thread_.joinable()) thread_.join();
    if (listener_ >= 0) ::close(listener_);
    listener_ = -1;
  }
  /// Keeps the connection, sends nothing any more.
  void hang() { hang_ = true; }
  /// Frames that the camera drops: their time passes, they do not come.
  std::function<bool(unsigned)> dropped = [](unsigned) { return false; };

 protected:
  virtual void serve(int client) = 0;
  bool over() const { return over_; }
  /// Waits for the time of frame `number`; false when the peer is to go.
  bool wait_for(unsigned number) {
    std::unique_lock lock(mutex_);
    const auto at = begin_ + std::chrono::duration<double>(number / rate_hz_);
    changed_.wait_until(lock, std::chrono::time_point_cast<std::chrono::steady_clock::duration>(at),
                        [&] { return over_.load(); });
    while (hang_ && !over_) changed_.wait_for(lock, std::chrono::milliseconds(20));
    return !over_;
  }
  void begin() { begin_ = std::chrono::steady_clock::now(); }
  double rate_hz() const { return rate_hz_; }
  static bool send_all(int client, const std::string& bytes) {
    for (std::size_t sent = 0; sent < bytes.size();) {
      const auto n = ::send(client, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
      if (n <= 0) return false;
      sent += static_cast<std::size_t>(n);
    }
    return true;
  }
  /// A request up to its empty line; empty when there is none within `timeout_ms` or the client has gone.
  static std::string receive(int client, int timeout_ms) {
    std::string request;
    pollfd p{client, POLLIN, 0};
    while (::poll(&p, 1, timeout_ms) > 0) {
      char c = 0;
      if (::recv(client, &c, 1, 0) != 1) return "";
      request += c;
      if (request.size() >= 4 && request.compare(request.size() - 4, 4, "\r\n\r\n") == 0) return request;
    }
    return "";
  }

 private:
  void accept_clients() {
    while (!over_) {
      pollfd p{listener_, POLLIN, 0};
      if (::poll(&p, 1, 20) <= 0) continue;
      const int client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (client < 0) continue;
      serve(client);
      ::close(client);
    }
  }
  const double rate_hz_;
  int port_ = 0, listener_ = -1;
  std::atomic<bool> over_{false}, hang_{false};
  std::chrono::steady_clock::time_point begin_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::thread thread_;
};

/// What cheap network cameras serve: multipart/x-mixed-replace.
class MjpegPeer : public VideoPeer {
 public:
  using VideoPeer::VideoPeer;
  ~MjpegPeer() override { stop(); }
  std::string url() const { return "http://127.0.0.1:" + std::to_string(port()) + "/video.mjpg"; }

 protected:
  void serve(int client) override {
    if (receive(client, 2000).empty()) return;
    if (!send_all(
            client,
            "HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n--frame\r\n"))
      return;
    begin();
    for (unsigned number = 0; wait_for(number); ++number) {
      if (dropped(number)) continue;
      std::vector<std::uint8_t> jpeg;
      cv::imencode(".jpg", numbered_image(number), jpeg);
      if (!send_all(client, "Content-Type: image/jpeg\r\nContent-Length: " + std::to_string(jpeg.size()) +
                                "\r\n\r\n" + std::string(jpeg.begin(), jpeg.end()) + "\r\n--frame\r\n"))
        return;
    }
  }
};

/// RTSP with interleaved RTP (RFC 2326, 10.12), uncompressed 4:2:2 video (RFC 4175), a line a packet.
class RtspPeer : public VideoPeer {
 public:
  using VideoPeer::VideoPeer;
  ~RtspPeer() override { stop(); }
  std::string url() const { return "rtsp://someone:secret@127.0.0.1:" + std::to_string(port()) + "/bow"; }

 protected:
  void serve(int client) override {
    while (!over()) {
      const std::string request = receive(client, 50);
      if (request.empty()) {
        char c = 0;
        if (::recv(client, &c, 1, MSG_PEEK | MSG_DONTWAIT) == 0) return;
        continue;
      }
      if (!answer(client, request)) return;
      if (request.rfind("PLAY", 0) == 0) return play(client);
    }
  }

 private:
  bool answer(int client, const std::string& request) {
    std::string more, body;
    if (request.rfind("OPTIONS", 0) == 0) more = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n";
    if (request.rfind("DESCRIBE", 0) == 0) {
      body =
          "v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=bow\r\nc=IN IP4 127.0.0.1\r\nt=0 0\r\nm=video 0 RTP/AVP "
          "96\r\n"
          "a=rtpmap:96 raw/90000\r\na=fmtp:96 sampling=YCbCr-4:2:2; width=320; height=240; depth=8; "
          "colorimetry=BT601-5\r\na=framerate:" +
          std::to_string(static_cast<int>(rate_hz())) + "\r\na=control:track0\r\n";
      more = "Content-Type: application/sdp\r\n";
    }
    if (request.rfind("SETUP", 0) == 0) more = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n";
    const std::size_t at = request.find("CSeq:");
    const std::string number = request.substr(at, request.find("\r\n", at) - at);
    return send_all(client, "RTSP/1.0 200 OK\r\n" + number + "\r\nSession: 7\r\n" + more +
                                "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body);
  }
  static void put16(std::string* out, unsigned value) {
    *out += static_cast<char>(value >> 8 & 0xff);
    *out += static_cast<char>(value & 0xff);
  }
  void play(int client) {
    begin();
    unsigned sequence = 0;
    for (unsigned number = 0; wait_for(number); ++number) {
      if (dropped(number)) continue;
      const auto stamp = static_cast<std::uint32_t>(1'000'000 + number * 90000.0 / rate_hz());
      const cv::Mat image = numbered_image(number);
      std::string bytes;
      for (int line = 0; line < 240; ++line, ++sequence) {
        bytes += '$';
        bytes += '\0';
        put16(&bytes, 12 + 2 + 6 + 640);
        bytes += static_cast<char>(0x80);
        bytes += static_cast<char>((line == 239 ? 0x80 : 0) | 96);
        put16(&bytes, sequence & 0xffff);
        put16(&bytes, stamp >> 16);
        put16(&bytes, stamp & 0xffff);
        put16(&bytes, 0);
        put16(&bytes, 77);
        put16(&bytes, sequence >> 16);  // extended sequence number
        put16(&bytes, 640);
        put16(&bytes, static_cast<unsigned>(line));
        put16(&bytes, 0);
        for (int x = 0; x < 320; ++x) {
          bytes += static_cast<char>(128);  // Cb, Cr in turn
          bytes += static_cast<char>(image.at<std::uint8_t>(line, x));
        }
      }
      if (!send_all(client, bytes)) return;
      std::string ignored(512, '\0');  // keep-alives and receiver reports
      while (::recv(client, ignored.data(), ignored.size(), MSG_DONTWAIT) > 0) {
      }
    }
  }
};

}  // namespace gnathion::test
