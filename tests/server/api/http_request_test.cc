// The syntax of requests: what is accepted, however it is split into pieces, and what is rejected
// because two parsers could read it differently.
#include "server/api/http_request.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

struct Read {
  RequestHead head;
  ApiError error;
  bool good = false;
  size_t size = 0;
};

// Reads like a connection: `piece` bytes at a time.
Read ReadHead(const std::string& bytes, size_t piece = 1) {
  HeadScanner scanner;
  Read read;
  for (size_t got = 0; got < bytes.size() && read.size == 0;) {
    got = std::min(got + piece, bytes.size());
    read.size = scanner.Scan(std::string_view(bytes).substr(0, got));
    if (scanner.error()) {
      read.error = *scanner.error();
      return read;
    }
  }
  if (read.size > 0) {
    read.good =
        ParseRequestHead(std::string_view(bytes).substr(0, read.size), read.head, read.error);
  }
  return read;
}

TEST(RequestHead, IsReadInAnyPieces) {
  const std::string text =
      "\r\nPOST /v1/artefacts?team=a%20b HTTP/1.1\r\nHost: x\r\nContent-Length: 12\r\n"
      "content-TYPE: Application/X-Tar; charset=x\r\nExpect: 100-continue\r\nRange: bytes=0-1\r\n"
      "X: y\r\n\r\n";
  for (size_t piece = 1; piece <= text.size(); ++piece) {
    const Read read = ReadHead(text + "body", piece);
    ASSERT_TRUE(read.good) << read.error.message;
    EXPECT_EQ(read.size, text.size());
    EXPECT_EQ(read.head.method, "POST");
    EXPECT_EQ(read.head.path, "/v1/artefacts");
    EXPECT_EQ(read.head.content_type, "application/x-tar");
    EXPECT_EQ(read.head.length, 12);
    EXPECT_TRUE(read.head.expects_continue && read.head.keep_alive && !read.head.chunked);
    EXPECT_EQ(read.head.canonical,
              "POST /v1/artefacts?team=a%20b HTTP/1.1\r\nHost: x\r\n"
              "content-TYPE: Application/X-Tar; charset=x\r\nX: y\r\n");
  }
}

TEST(RequestHead, KeepsATokenApartAndTakesOneAlone) {
  const Read read = ReadHead("GET / HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer abc\r\n\r\n");
  ASSERT_TRUE(read.good) << read.error.message;
  EXPECT_EQ(read.head.authorization, "Bearer abc");
  EXPECT_THAT(read.head.canonical, Not(HasSubstr("Bearer")));
  const Read two = ReadHead(
      "GET / HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer abc\r\nauthorization: Bearer abc\r\n\r\n");
  EXPECT_FALSE(two.good);
  EXPECT_THAT(two.error.message, HasSubstr("Authorization is there twice"));
}

TEST(RequestHead, SaysWhetherTheConnectionIsKept) {
  const auto kept = [](const std::string& rest) {
    const Read read = ReadHead("GET / " + rest + "\r\nHost: h\r\n\r\n");
    EXPECT_TRUE(read.good) << rest;
    return read.head.keep_alive;
  };
  EXPECT_TRUE(kept("HTTP/1.1"));
  EXPECT_FALSE(kept("HTTP/1.1\r\nConnection: close"));
  EXPECT_FALSE(kept("HTTP/1.1\r\nConnection: x, Close"));
  EXPECT_FALSE(kept("HTTP/1.0"));
  EXPECT_TRUE(kept("HTTP/1.0\r\nConnection: keep-alive"));
}

TEST(RequestHead, HasOneHostUnlessItIsOld) {
  const auto host_of = [](const std::string& headers, const std::string& version = "1.1") {
    const Read read = ReadHead("GET / HTTP/" + version + "\r\n" + headers + "\r\n");
    return read.good ? read.head.host : std::to_string(read.error.http);
  };
  EXPECT_EQ(host_of("Host: Grader.Example.org:8443\r\n"), "grader.example.org");
  EXPECT_EQ(host_of("Host: [::1]:80\r\n"), "[::1]");
  EXPECT_EQ(host_of("Host: 127.0.0.1\r\n"), "127.0.0.1");
  EXPECT_EQ(host_of("Host:\r\n"), "");
  EXPECT_EQ(host_of("", "1.0"), "");
  for (const char* bad : {"", "Host: a\r\nHost: a\r\n", "Host: a b\r\n", "Host: a/b\r\n", "Host: a@b\r\n",
                          "Host: a:b\r\n", "Host: [::1\r\n", "Host: [x]\r\n", "Host: [::1]x\r\n"}) {
    EXPECT_EQ(host_of(bad), "400") << bad;
  }
  EXPECT_EQ(host_of("Host: a\r\nHost: a\r\n", "1.0"), "400");
  const Read absolute = ReadHead("GET http://Other.example:80/a?b HTTP/1.1\r\nHost: h\r\n\r\n");
  ASSERT_TRUE(absolute.good) << absolute.error.message;
  EXPECT_EQ(absolute.head.host, "other.example");
  EXPECT_THAT(absolute.head.canonical, StartsWith("GET /a?b HTTP/1.1\r\n"));
}

TEST(RequestHead, AQueryMayHaveQuestionMarks) {
  const Read read = ReadHead("GET /sign-in?to=/a?b=c?d HTTP/1.1\r\nHost: h\r\n\r\n");
  ASSERT_TRUE(read.good) << read.error.message;
  EXPECT_EQ(read.head.path, "/sign-in");
  EXPECT_THAT(read.head.canonical, StartsWith("GET /sign-in?to=/a%3Fb=c%3Fd HTTP/1.1\r\n"));
  EXPECT_THAT(ReadHead("GET /a HTTP/1.1\r\nHost: h\r\n\r\n").head.canonical,
              StartsWith("GET /a HTTP/1.1\r\n"));
}

TEST(RequestHead, WhatCanBeReadInTwoWaysIsRefused) {
  const std::string post = "POST / HTTP/1.1\r\nHost: localhost\r\n";
  const std::vector<std::pair<std::string, int>> bad = {
      {post + "Content-Length: 1\r\nContent-Length: 1\r\n\r\n", 400},
      {post + "Content-Length: 1\r\nTransfer-Encoding: chunked\r\n\r\n", 400},
      {post + "Transfer-Encoding: gzip, chunked\r\n\r\n", 501},
      {post + "Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n\r\n", 501},
      {post + "Content-Length: +1\r\n\r\n", 400},
      {post + "Content-Length: -1\r\n\r\n", 400},
      {post + "Content-Length: 0x1\r\n\r\n", 400},
      {post + "Content-Length: 1, 1\r\n\r\n", 400},
      {post + "Content-Length: 9999999999999999999\r\n\r\n", 400},
      {post + "Content-Length:\r\n\r\n", 400},
      {post + "Content-Length : 1\r\n\r\n", 400},
      {post + "Content-Type: a\r\nContent-Type: b\r\n\r\n", 400},
      {post + "Content-Encoding: gzip\r\n\r\n", 415},
      {post + "Expect: 200-maybe\r\n\r\n", 417},
      {post + "A: b\r\n c\r\n\r\n", 400},
      {post + "no colon\r\n\r\n", 400},
      {post + ": b\r\n\r\n", 400},
      {"GET / HTTP/1.1\nA: b\r\n\r\n", 400},
      {"GET / HTTP/1.1\r\nHost: localhost\r\nA: b\rc\r\n\r\n", 400},
      {std::string("GET / HTTP/1.1\r\nHost: localhost\r\nA: b\0c\r\n\r\n", 44), 400},
      {"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1\r\n\r\n", 400},
      {"GET /  HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET http://x HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET ftp://x/ HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET http://a@b/ HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET /\xc3\xa4 HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET / HTTP/2.0\r\n\r\n", 505},
      {"G(T / HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET\r\n\r\n", 400},
      {"GET /" + std::string(9000, 'a') + " HTTP/1.1\r\n\r\n", 414},
      {"GET / HTTP/1.1\r\nHost: localhost\r\nA: " + std::string(9000, 'a') + "\r\n\r\n", 431},
      {"GET / HTTP/1.1\r\nHost: localhost\r\n" + std::string(40000, 'a'), 431},
      {"GET / HTTP/1.1\r\nHost: localhost\r\n" + [] {
         std::string lines;
         for (int i = 0; i < 200; ++i) lines += "A: b\r\n";
         return lines;
       }() + "\r\n", 431}};
  for (const auto& [text, http] : bad) {
    for (const size_t piece : {size_t{1}, size_t{7}, text.size()}) {
      const Read read = ReadHead(text, piece);
      EXPECT_FALSE(read.good) << text;
      EXPECT_EQ(read.error.http, http) << text << ": " << read.error.message;
      EXPECT_THAT(read.error.message, Not(HasSubstr("\n")));
    }
  }
}

struct Taken {
  std::string body;
  std::string rest;
  bool done = false;
  int error = 0;
};

Taken TakeBody(const RequestHead& head, std::string_view bytes, size_t piece, int64_t most = 100) {
  BodyReader reader(head, most);
  Taken taken;
  std::string in;
  for (size_t got = 0; got < bytes.size(); got += piece) {
    in += bytes.substr(got, piece);
    in.erase(0, reader.Take(in, taken.body));
  }
  taken.rest = in;
  taken.done = reader.done();
  taken.error = reader.error() ? reader.error()->http : 0;
  return taken;
}

TEST(BodyReader, TakesWhatIsTheBodysAndNoMore) {
  RequestHead head;
  head.length = 5;
  RequestHead chunked;
  chunked.chunked = true;
  for (size_t piece = 1; piece < 30; ++piece) {
    const Taken plain = TakeBody(head, "helloGET", piece);
    EXPECT_TRUE(plain.done);
    EXPECT_EQ(plain.body, "hello");
    EXPECT_EQ(plain.rest, "GET");
    const Taken chunks = TakeBody(
        chunked, "3\r\nhel\r\n2;name=value\r\nlo\r\n00\r\nTrailer: x\r\n\r\nGET", piece);
    EXPECT_TRUE(chunks.done) << chunks.error;
    EXPECT_EQ(chunks.body, "hello");
    EXPECT_EQ(chunks.rest, "GET");
  }
  EXPECT_FALSE(TakeBody(head, "hell", 1).done);
  EXPECT_FALSE(TakeBody(chunked, "3\r\nhel\r\n0\r\n", 1).done) << "the last line is missing";
}

TEST(BodyReader, BrokenChunksAndLongBodiesAreRefused) {
  RequestHead chunked;
  chunked.chunked = true;
  for (const char* text :
       {"x\r\n", "\r\n", "-1\r\n", "0x3\r\nabc", "3\nabc", "3\r\nabcd\r\n", "+3\r\nabc\r\n",
        "ffffffffffffffff\r\n"}) {
    for (const size_t piece : {1, 3, 100}) {
      EXPECT_EQ(TakeBody(chunked, text, piece).error, 400) << text;
    }
  }
  EXPECT_EQ(TakeBody(chunked, std::string(5000, '1'), 1).error, 400);
  EXPECT_EQ(TakeBody(chunked, "65\r\n", 1).error, 413) << "101 bytes";
  EXPECT_EQ(TakeBody(chunked, "64\r\n" + std::string(100, 'a') + "\r\n1\r\n", 9).error, 413);
  std::string trailers = "0\r\n";
  for (int i = 0; i < 10'000; ++i) trailers += "A: b\r\n";
  EXPECT_EQ(TakeBody(chunked, trailers, 100).error, 431);
  RequestHead head;
  head.length = 101;
  EXPECT_EQ(TakeBody(head, "a", 1).error, 413);
}

TEST(RefusalBytes, IsAWholeAnswer) {
  const std::string text = RefusalBytes({429, "too_many", "not \"now\""});
  EXPECT_THAT(text, ::testing::StartsWith("HTTP/1.1 429 Too Many Requests\r\n"));
  EXPECT_THAT(text, HasSubstr("Retry-After: 1\r\n"));
  EXPECT_THAT(text, HasSubstr("Connection: close\r\n"));
  EXPECT_THAT(text, ::testing::EndsWith(
      "\r\n\r\n{\"error\":{\"code\":\"too_many\",\"message\":\"not \\\"now\\\"\"}}\n"));
}

}  // namespace
}  // namespace myograde::server
