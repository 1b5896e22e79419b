// A proxy between a browser and the service, which records requests, counts streams of events, rejects
// requests, or holds them back.

import { createServer, request as forward } from "node:http";
import { connect } from "node:net";
import { once } from "node:events";

/** Starts a proxy to this port. `onRequest(path)` returns the status to reject a request with, "hold", or nothing. */
export async function startProxy(port) {
  const proxy = { paths: [], onRequest: () => null, openStreams: 0, mostStreams: 0 };
  const decide = (url, connection) => {
    // The first part of a path is the token.
    const path = url.replace(/^\/[^/]*\//, "");
    proxy.paths.push(path);
    if (/^api\/v1\/events(\/ws)?$/.test(path)) {
      proxy.openStreams += 1;
      proxy.mostStreams = Math.max(proxy.mostStreams, proxy.openStreams);
      connection.on("close", () => { proxy.openStreams -= 1; });
    }
    return proxy.onRequest(path);
  };
  const server = createServer((incoming, outgoing) => {
    const decision = decide(incoming.url, outgoing);
    if (decision === "hold") return;
    if (decision) {
      outgoing.writeHead(decision, { "content-type": "application/problem+json" });
      outgoing.end(JSON.stringify({ title: "busy", status: decision, detail: "rejected by the test" }));
      return;
    }
    const { method, url, headers } = incoming;
    const upstream = forward({ port, host: "127.0.0.1", method, path: url, headers }, (response) => {
      outgoing.writeHead(response.statusCode, response.headers);
      response.pipe(outgoing);
      response.on("error", () => outgoing.destroy());
    });
    upstream.on("error", () => outgoing.destroy());
    outgoing.on("close", () => upstream.destroy());
    incoming.pipe(upstream);
  });
  server.on("upgrade", (incoming, socket, head) => {
    socket.on("error", () => socket.destroy());
    const decision = decide(incoming.url, socket);
    if (decision === "hold") return;
    if (decision) {
      socket.end(`HTTP/1.1 ${decision} Rejected\r\nconnection: close\r\ncontent-length: 0\r\n\r\n`);
      return;
    }
    const upstream = connect(port, "127.0.0.1", () => {
      const lines = Object.entries(incoming.headers).map(([name, value]) => `${name}: ${value}`);
      upstream.write([`GET ${incoming.url} HTTP/1.1`, ...lines, "", ""].join("\r\n"));
      upstream.write(head);
      upstream.pipe(socket).pipe(upstream);
    });
    for (const end of ["error", "close"]) upstream.on(end, () => socket.destroy());
    socket.on("close", () => upstream.destroy());
  });
  server.listen(0, "127.0.0.1");
  await once(server, "listening");
  proxy.port = server.address().port;
  proxy.close = () => {
    server.close();
    server.closeAllConnections();
  };
  return proxy;
}
