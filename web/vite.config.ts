import { svelte } from '@sveltejs/vite-plugin-svelte';
import { defineConfig } from 'vitest/config';

export default defineConfig({
  plugins: [svelte()],
  base: '/',
  build: {
    outDir: '../gcs/api/dashboard',
    emptyOutDir: true,
    target: 'es2022',
    // three.js is needed at once: splitting it off would only add a round trip.
    chunkSizeWarningLimit: 1000,
  },
  test: { include: ['src/**/*.test.ts'] },
});
