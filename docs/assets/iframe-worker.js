// Search from disk: browsers start no Worker for pages opened as files, so a hidden frame stands in for it.
// The theme's search asks for no more of a Worker than this: messages to and fro, and importScripts.
(() => {
  if (location.protocol !== "file:") return

  // runs in the frame, which plays the worker
  const scope = `
    postMessage = (data) => parent.postMessage(data, "*")
    importScripts = (...urls) => urls.reduce((done, src) => done.then(() => new Promise((loaded) => {
      document.body.append(Object.assign(document.createElement("script"), { src, onload: loaded }))
    })), Promise.resolve())`

  window.Worker = class FrameWorker extends EventTarget {
    constructor(url) {
      super()
      this.frame = document.body.appendChild(Object.assign(document.createElement("iframe"), { hidden: true }))
      this.heard = (event) => {
        if (event.source !== this.frame.contentWindow) return
        this.dispatchEvent(new MessageEvent("message", { data: event.data }))
      }
      window.addEventListener("message", this.heard)
      const inside = this.frame.contentWindow
      this.ready = new Promise((loaded) => {
        inside.document.open()
        inside.document.write(`<body><script>${scope}<\/script><script src="${url}"><\/script></body>`)
        inside.document.close()
        inside.addEventListener("load", loaded)
      })
    }

    postMessage(data) {
      this.ready.then(() => {
        this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data: structuredClone(data) }))
      })
    }

    terminate() {
      window.removeEventListener("message", this.heard)
      this.frame.remove()
    }
  }
})()
